"""`twin diagnose` of several campaigns: a line for each rig as it ends, then the table over all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from twin.commands.opening import check_opener, open_results
from twin.commands.shared import console
from twin.commands.shared import executor as workers_of
from twin.errors import InputError
from twin.files.json import write_json
from twin.files.outputs import check_writable
from twin.terminal import BAD_INPUT, report_error

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from twin.fleet.answer import Fleet, RigResult
    from twin.fleet.run import Asked


@dataclass(frozen=True)
class FleetOptions:
    """The options of `twin diagnose`, as they were given."""

    out: Path | None
    json_file: Path | None
    force: bool
    false_alarm_rate: float
    rig: Path | None
    opener: Literal["report", "viewer"] | None
    workers: int | None
    scheduler: str | None


def diagnose_fleet(campaigns: Sequence[Path], options: FleetOptions) -> None:
    """Diagnoses several campaigns; exit code 2 where one of them could not be."""
    from twin.fleet.run import diagnose_fleet as run

    _check(options)
    asked = _asked(campaigns, options)
    with _executor(options, len(asked.campaigns)) as executor, _lines(asked) as ended:
        fleet = run(asked, executor, ended)
    if options.json_file is not None:
        write_json(options.json_file, fleet.to_json())
    _print(fleet, asked.out, options.json_file)
    failed = open_results(options.opener, {"report": asked.out / "fleet.html"})
    if failed:
        console().print(failed)
    if fleet.failures:
        raise typer.Exit(BAD_INPUT)


def _check(options: FleetOptions) -> None:
    """Raises InputError where options do not go together."""
    if options.scheduler is not None and options.workers is not None:
        raise InputError("--workers and --scheduler both say who does it; expected one of them")
    if options.opener == "viewer":
        raise InputError("--open viewer shows the recording of one rig; expected --open report for several")
    check_opener(options.opener)


def _asked(campaigns: Sequence[Path], options: FleetOptions) -> Asked:
    """What is asked, its destinations checked."""
    from twin.files.provenance import command_line
    from twin.fleet.run import Asked, default_folder, input_files
    from twin.fleet.store import FOLDER

    place = default_folder(campaigns) if options.out is None else options.out
    folder = FOLDER.choose(place, place, options.force)
    asked = Asked(tuple(campaigns), folder, options.rig, options.false_alarm_rate, command_line())
    written = FOLDER.output_files(folder, options.json_file)
    check_writable(options.json_file, made=folder, beside=written, read=input_files(asked))
    return asked


@contextmanager
def _executor(options: FleetOptions, rigs: int) -> Iterator[Executor]:
    from twin.executors.processes import processes

    with workers_of(options.scheduler) as elsewhere:
        if elsewhere is not None:
            yield elsewhere
            return
        with processes(min(options.workers or os.cpu_count() or 1, rigs)) as here:
            yield here


@contextmanager
def _lines(asked: Asked) -> Iterator[Callable[[RigResult], None]]:
    """Yields a function that prints the result of a rig on standard error; with --quiet, errors alone."""
    from twin.commands.screen import Screen, is_quiet
    from twin.fleet import text
    from twin.fleet.answer import RigFailure

    screen, count = Screen(stderr=True, quiet=is_quiet()), len(dict.fromkeys(asked.campaigns))
    ended = 0

    def show(result: RigResult) -> None:
        nonlocal ended
        ended += 1
        if isinstance(result, RigFailure):
            report_error(text.line(result))
        else:
            screen.print(f"[{ended} of {count}] {text.line(result)}", soft_wrap=True)
        status.update(_still(count - ended))

    with screen.status(_still(count), spinner="line" if screen.options.ascii_only else "dots") as status:
        yield show


def _still(rigs: int) -> str:
    return f"{rigs} {'rig' if rigs == 1 else 'rigs'} to go"


def _print(fleet: Fleet, folder: Path, json_file: Path | None) -> None:
    from rich.table import Table

    from twin.fleet import store, text

    screen = console()
    screen.print(" ".join([text.headline(fleet), *text.remarks(fleet)]))
    screen.print()
    table = Table(*text.COLUMNS, box=None, pad_edge=False)
    for rig in fleet.rigs:
        table.add_row(*text.row(rig))
    screen.print(table)
    screen.print()
    for name, count, which in text.effects(fleet):
        screen.print(f"{name}: {count} ({which})")
    paths = {what: folder / name for what, name in store.FILES.items()}
    for what, path in {**paths, **({"JSON": json_file} if json_file else {})}.items():
        screen.print(f"{what:<6}  {path}", soft_wrap=True)
