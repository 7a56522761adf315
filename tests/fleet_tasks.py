"""Tasks in the place of a diagnosis: they take no time, and workers import them by name."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path

from twin.errors import InputError
from twin.fleet.task import Contents, Task

ANSWER = "diagnosis.json"  # not imported with all that makes it: a worker would load that for seconds
STIFFNESS = 0.012


def answer(
    task: Task, verdict: str = "explained", effects: tuple[dict, ...] | None = None, **changes
) -> dict:
    """Returns what a fleet reads of an answer, as it is in a JSON file; `changes` replace values."""
    cable = {
        "name": "cable-torsion",
        "probability": 0.92,
        "parameters": {"stiffness": STIFFNESS},
        "standard_errors": {"stiffness": 1e-4},
    }
    found = {
        "campaign": task.campaign.name,
        "verdict": verdict,
        "effects": [cable] if effects is None else list(effects),
        "ranking": [],
        "errors": {},
        "indistinguishable": [["cable-torsion", "cogging"]],
        "depends_on": [],
        "next_experiment": None,
        "calibrated": {"hub_inertia": {"declared": 0.02, "fitted": 0.021, "standard_error": 1e-4}},
        "false_alarm_rate": task.false_alarm_rate,
        "wall_s": 1.0,
        "provenance": task.record.to_json(),
    }
    return found | changes


def solved(task: Task, log: Path | None = None, **changes) -> Contents:
    """Answers at once, and notes in a file which rig it was and in which process."""
    if log is not None:
        _note(log, task)
    return {ANSWER: json.dumps(answer(task, **changes)), "report.html": "<p>report</p>", "patch.csv": None}


def solved_slowly(task: Task, log: Path, seconds: float) -> Contents:
    """The same, so late [s]."""
    _note(log, task)
    time.sleep(seconds)
    return solved(task)


def refused(task: Task) -> Contents:
    """Fails as a diagnosis of bad data."""
    raise InputError("push.csv: nothing moves; expected a motion")


def failed(task: Task) -> Contents:
    """Fails as nothing should."""
    raise ZeroDivisionError("division by zero")


def killed(task: Task, rig: str) -> Contents:
    """Ends the process where it is the turn of a rig."""
    if task.campaign.name == rig:
        os._exit(1)
    return solved(task)


def _note(log: Path, task: Task) -> None:
    with log.open("a") as file:
        file.write(f"{task.campaign.name} {os.getpid()}\n")


def noted(log: Path) -> list[tuple[str, int]]:
    """Returns what the tasks have noted: rig and process."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [(rig, int(process)) for rig, process in map(str.split, lines)]


class SlowToSend:
    """A result that takes longer to be sent than any test waits, and notes when that begins."""

    def __init__(self, begun: Path) -> None:
        self._begun = begun

    def __reduce__(self):
        self._begun.touch()
        time.sleep(120)
        return SlowToSend, (self._begun,)


def itself(run: str, job: object, rigs: Sequence[object]) -> list[object]:
    """Returns rigs in the place of their outcomes."""
    return list(rigs)


def case(number: int, folder: Path) -> dict:
    """A case of a benchmark, which makes a campaign and answers."""
    folder.mkdir()
    (folder / "campaign.toml").write_text("")
    return {"number": number, "process": os.getpid()}


def failing_case(number: int, folder: Path) -> dict:
    """A case of a benchmark, of which the first fails."""
    if number == 1:
        folder.mkdir()
        raise ValueError("singular")
    return case(number, folder)
