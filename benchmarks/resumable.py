"""Benchmarks of many campaigns that can be interrupted and resumed, in processes or on the workers of a Dask scheduler.

The answers are in `answers.jsonl` of the working folder, a line of JSON for each campaign; copied to another folder or
machine, the run continues there.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TypeVar

from rich.progress import track

Task = TypeVar("Task")
FILE = "answers.jsonl"


def parser(description: str, jobs: int) -> argparse.ArgumentParser:
    """Returns a parser with the options of all such benchmarks: work, jobs, scheduler and minutes."""
    result = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    result.add_argument("work", type=Path)
    result.add_argument("--jobs", type=int, default=jobs)
    add_scheduler(result)
    result.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no campaign later than that"
    )
    return result


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Adds the option --scheduler."""
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler whose workers take the place of the processes",
    )


def answers(
    tasks: Mapping[str, Task], solve: Callable[[Task, Path], dict], options: argparse.Namespace
) -> list[dict]:
    """Solves the tasks without an answer until the time is over; returns all answers in the order of the tasks.

    One that fails keeps its folder, and is reported when the others are done.

    Args:
      tasks: name -> what to solve.
      solve: takes a task and a folder for its campaign, which is removed afterwards; picklable.
      options: of `parser`.

    Raises:
      RuntimeError: tasks have failed.
    """
    latest = time.time() + 60 * options.minutes
    options.work.mkdir(parents=True, exist_ok=True)
    file = options.work / FILE
    found = _read_answers(file)
    elsewhere, failed = options.scheduler is not None, dict[str, BaseException]()
    with _executor(options) as pool, file.open("a", encoding="utf-8") as written:
        jobs = {
            pool.submit(_solve_in_time, solve, task, None if elsewhere else options.work / name, latest): name
            for name, task in tasks.items()
            if name not in found
        }
        for job in track(as_completed(jobs), "campaigns", len(jobs), disable=not sys.stdout.isatty()):
            if (error := job.exception()) is not None:
                failed[jobs[job]] = error
            elif (answer := job.result()) is not None:
                found[jobs[job]] = answer
                line = json.dumps({"campaign": jobs[job], "answer": answer}, separators=(",", ":"))
                print(line, file=written, flush=True)
    if failed:
        raise RuntimeError(f"no answer to {', '.join(failed)}") from next(iter(failed.values()))
    return [found[name] for name in tasks if name in found]


def _executor(options: argparse.Namespace) -> AbstractContextManager[Executor]:
    """Where the tasks run."""
    if options.scheduler is None:
        return ProcessPoolExecutor(options.jobs)
    from twin.executors.scheduler import scheduler

    _send_benchmarks()
    return scheduler(options.scheduler)


def _send_benchmarks() -> None:
    """Has the modules of this folder go to the workers with each task: unlike the package, they are not installed."""
    import cloudpickle

    here = Path(__file__).resolve().parent
    for module in list(sys.modules.values()):
        file = getattr(module, "__file__", None)
        if file and Path(file).resolve().parent == here and module.__name__ != "__main__":
            cloudpickle.register_pickle_by_value(module)


def _read_answers(file: Path) -> dict[str, dict]:
    """Answers of a file by campaign; an incomplete last line, of an interrupted run, is removed from the file."""
    if not file.exists():
        return {}
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        file.write_text(whole, encoding="utf-8")
    lines = [json.loads(line) for line in whole.splitlines()]
    return {line["campaign"]: line["answer"] for line in lines}


def _solve_in_time(
    solve: Callable[[Task, Path], dict], task: Task, folder: Path | None, latest: float
) -> dict | None:
    """The answer of a task; None if it is later than `latest` [s since the epoch].

    Without a folder for its campaign, as on another machine, it takes a temporary one.
    """
    if time.time() > latest:
        return None
    if folder is None:
        with tempfile.TemporaryDirectory() as there:
            return solve(task, Path(there) / "campaign")
    found = solve(task, folder)
    shutil.rmtree(folder)
    return found
