"""Where tasks run: in processes of this machine, or on the workers of a Dask scheduler.

Both are a `concurrent.futures.Executor`, and so is any other that a caller has: what runs tasks takes one.
"""

from __future__ import annotations

from concurrent.futures import BrokenExecutor, CancelledError


def lost_its_process(error: BaseException) -> bool:
    """Whether a task has no result because the process that ran it ended, and with Dask, several one after another."""
    # By its name, as Dask is the library of an extra.
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def lost_its_executor(error: BaseException) -> bool:
    """Whether a task has no result because what ran all tasks has ended."""
    return isinstance(error, CancelledError)
