"""Diagnoses the rigs of a fleet on an executor; those that have an answer already are not diagnosed again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path

from twin.campaigns.campaign import Campaign, campaign_files, read_campaign
from twin.campaigns.declared_rig import with_rig
from twin.diagnosis.diagnose import FALSE_ALARM_RATE, checked_rate
from twin.diagnosis.permutation import SEEDS
from twin.errors import InputError, quoted
from twin.executors import lost_its_executor, lost_its_process
from twin.files.provenance import recorded
from twin.fleet import page, store, stored
from twin.fleet.answer import Fleet, RigAnswer, RigFailure, RigResult
from twin.fleet.store import FOLDER
from twin.fleet.stored import StoredAnswer
from twin.fleet.task import Contents, Solve, Task, diagnosed
from twin.report.deliver import ANSWER
from twin.rigs.rig_file import read_rig_file

_MOST_AT_ONCE = 1000
"""Tasks with an executor at once: beyond the workers of most clusters, and a few GB of recordings in memory."""


@dataclass(frozen=True)
class Asked:
    """What is asked of a fleet.

    Attributes:
      campaigns: folder of each rig's campaign.
      out: folder of the results, as `store.FOLDER.choose` returns it.
      rig: file that declares the rig instead of the campaigns, or None.
      false_alarm_rate: of each diagnosis.
      command: the command line, for the record, or None.
    """

    campaigns: Sequence[Path]
    out: Path
    rig: Path | None = None
    false_alarm_rate: float = FALSE_ALARM_RATE
    command: str | None = None


@dataclass(frozen=True)
class _Job:
    """A rig that has to be diagnosed."""

    rig: str
    campaign: Path
    folder: Path
    task: Task
    previous: StoredAnswer | None
    kept: str | None  # the file of that answer, where it has to be written


def diagnose_fleet(
    asked: Asked, executor: Executor, ended: Callable[[RigResult], None], solve: Solve = diagnosed
) -> Fleet:
    """Diagnoses every rig that has no answer of the same files, and writes all results.

    Args:
      asked: campaigns and destination.
      executor: where the diagnoses run; its workers need no access to the files.
      ended: called with the result of each rig as it is there.
      solve: diagnoses one.

    Raises:
      InputError: the rate or the file of the rig cannot be used, what runs the diagnoses has ended, or the page cannot
        be written. A rig that cannot be diagnosed is in the answer.
    """
    checked_rate(asked.false_alarm_rate)
    found = {}
    for result in _results(_prepared(asked), executor, solve):
        found[result.campaign] = result
        ended(result)
    record = recorded((asked.rig,), None, asked.command, SEEDS)
    fleet = Fleet(tuple(found[campaign] for campaign in dict.fromkeys(asked.campaigns)), record)
    page.deliver(fleet, asked.out)
    return fleet


def default_folder(campaigns: Sequence[Path]) -> Path:
    """Returns the folder of the results: in the working directory, named after the one that holds all campaigns."""
    return FOLDER.named_after(Path(os.path.commonpath([c.resolve().parent for c in campaigns])))


def input_files(asked: Asked) -> Iterator[Path]:
    """Yields the files that a fleet reads; those of a campaign that cannot be used are left out."""
    if asked.rig is not None:
        yield asked.rig
    for campaign in asked.campaigns:
        try:
            yield from campaign_files(campaign)
        except InputError:
            continue


# Before a diagnosis


def _prepared(asked: Asked) -> Iterator[_Job | RigResult]:
    """Yields what is to do for each campaign, or its result where nothing is."""
    declared = None if asked.rig is None else read_rig_file(asked.rig)
    taken = {name.casefold(): name for name in store.FILES.values()}
    for folder in dict.fromkeys(asked.campaigns):
        try:
            campaign = read_campaign(folder)
            given = campaign if declared is None else with_rig(campaign, *declared)
            record = recorded((*campaign_files(folder), asked.rig), folder, asked.command, SEEDS)
        except InputError as error:
            yield RigFailure(folder.resolve().name or str(folder), folder, str(error))
            continue
        try:
            place = asked.out / _free_name(campaign, folder, taken)
            store.RIG.choose(place, folder)
        except InputError as error:
            yield RigFailure(campaign.name, folder, str(error))
            continue
        yield _to_do(Task(given, record, asked.false_alarm_rate), folder, place)


def _free_name(campaign: Campaign, folder: Path, taken: dict[str, str]) -> str:
    """The name of the folder of a rig's results, and notes that it is taken.

    Raises:
      InputError: it is the same as that of another rig.
    """
    name = store.folder_name(campaign.name)
    # Some file systems do not tell capitals from small letters.
    other = taken.setdefault(name.casefold(), str(folder))
    if other != str(folder):
        raise InputError(
            f"campaign.toml has the name {quoted(campaign.name)}, and results in a folder {name}, as {other} has; "
            "expected another name for each rig"
        )
    return name


def _to_do(task: Task, campaign: Path, place: Path) -> _Job | RigAnswer:
    there, name = store.earlier(place), task.campaign.name
    previous, kept = there.compared_with(task.record)
    if there.last is not None and there.answers(task.record, task.false_alarm_rate):
        return RigAnswer(name, campaign, place, there.last, previous, reused=True)
    return _Job(name, campaign, place, task, previous, kept)


# Diagnoses


def _results(prepared: Iterator[_Job | RigResult], executor: Executor, solve: Solve) -> Iterator[RigResult]:
    """Yields the result of each rig as it is there.

    Raises:
      InputError: what runs the diagnoses has ended.
    """
    running: dict[Future[Contents], _Job] = {}
    try:
        for rig in prepared:
            if not isinstance(rig, _Job):
                yield rig
                continue
            running[_submitted(executor, solve, rig.task)] = rig
            yield from _ended(running, None if len(running) >= _MOST_AT_ONCE else 0.0)
        while running:
            yield from _ended(running, None)
    finally:
        for future in running:
            future.cancel()


def _submitted(executor: Executor, solve: Solve, task: Task) -> Future[Contents]:
    """The task with the executor; one that takes no more is as one that loses it."""
    try:
        return executor.submit(solve, task)
    except BrokenExecutor as error:
        lost: Future[Contents] = Future()
        lost.set_exception(error)
        return lost


def _ended(running: dict[Future[Contents], _Job], timeout: float | None) -> Iterator[RigResult]:
    """Yields the results of diagnoses that have ended, and takes them out; waits for one, or so long [s]."""
    for future in wait(running, timeout, FIRST_COMPLETED).done:
        yield _result(running.pop(future), future)


def _result(job: _Job, ended: Future[Contents]) -> RigResult:
    """Writes the results of a diagnosis that has ended.

    Raises:
      InputError: what ran it has ended, and all others with it.
    """
    try:
        contents = ended.result()
        store.write(job.folder, contents, job.kept)
        answer = stored.parsed(contents[ANSWER] or "")
        assert answer is not None
        return RigAnswer(job.rig, job.campaign, job.folder, answer, job.previous)
    except Exception as error:
        if lost_its_executor(error):
            raise InputError(
                "what ran the diagnoses has ended; rigs that have an answer keep it: the same command again goes on "
                "with the others"
            ) from None
        return RigFailure(job.rig, job.campaign, _why(error))


def _why(error: Exception) -> str:
    """Why a rig has no diagnosis."""
    if isinstance(error, InputError):
        return str(error)
    if lost_its_process(error):
        return "the process that diagnosed it ended, killed or out of memory; the same command again goes on with it"
    return f"its diagnosis failed: {type(error).__name__}: {error}"
