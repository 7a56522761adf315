"""Where tasks run: in processes of this machine, or on the workers of a Dask scheduler.

Both are a `concurrent.futures.Executor`, and so is any other that a caller has: what runs tasks takes one.
"""

from __future__ import annotations

from concurrent.futures import BrokenExecutor, CancelledError


def is_lost(error: BaseException) -> bool:
    """Whether a task has no result because what ran it ended, not because the task failed."""
    # By its name, as Dask is the library of an extra: every worker that began the task has ended.
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ == "KilledWorker"
