"""Benchmarks of many campaigns, one JSON answer each: an interrupted run goes on from the answers that are there."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TypeVar

from rich.progress import track

Task = TypeVar("Task")


def parser(description: str, jobs: int) -> argparse.ArgumentParser:
    """Returns a parser of the options that all such benchmarks have: work, jobs and minutes."""
    found = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found.add_argument("work", type=Path)
    found.add_argument("--jobs", type=int, default=jobs)
    found.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no campaign later than that"
    )
    return found


def answers(
    tasks: Mapping[str, Task], solve: Callable[[Task, Path], dict], options: argparse.Namespace
) -> list[dict]:
    """Returns the answers that are there when all is done or the time is over, in no order.

    Args:
      tasks: name -> what to solve.
      solve: takes a task and a folder for its campaign, which is removed afterwards; a function of a module.
      options: of `parser`.
    """
    latest = time.time() + 60 * options.minutes
    options.work.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(options.jobs) as pool:
        jobs = [
            pool.submit(_answer, solve, task, options.work / name, latest) for name, task in tasks.items()
        ]
        done = track(as_completed(jobs), "campaigns", len(jobs), disable=not sys.stdout.isatty())
        return [found for job in done if (found := job.result()) is not None]


def _answer(solve: Callable[[Task, Path], dict], task: Task, folder: Path, latest: float) -> dict | None:
    """The answer, written down beside the folder; None where there is none and it is later than `latest` [s]."""
    path = folder.with_name(f"{folder.name}.json")
    if path.exists():
        return json.loads(path.read_text())
    if time.time() > latest:
        return None
    found = solve(task, folder)
    path.write_text(json.dumps(found, indent=1))
    shutil.rmtree(folder)
    return found
