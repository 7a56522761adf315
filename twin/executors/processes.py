"""Processes of this machine that run tasks, and end with the one that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any


class _Processes(ProcessPoolExecutor):
    """Starts processes as tasks come, without the script that runs, and deaf to Ctrl-C."""

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        with _script_hidden(), _interrupts_ignored():
            return super().submit(task, *given, **named)


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """Yields an executor of so many processes; where its block raises, they are ended at once."""
    # "spawn": a forked process may deadlock, because numerical libraries have started threads.
    fresh = multiprocessing.get_context("spawn")
    others = multiprocessing.active_children()
    pool = _Processes(count, fresh, _start_process)
    try:
        yield pool
    except BaseException:
        # What they compute is not wanted any more: do not wait for it.
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _script_hidden() -> Iterator[None]:
    """Hides the running script from processes that are started: all that they need is in this package.

    Otherwise each of them would run the script again, and a script without `if __name__ == "__main__"` would not end.
    """
    main = sys.modules["__main__"]
    hidden = {name: vars(main).get(name) for name in ("__file__", "__spec__")}
    vars(main).update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        vars(main).update(hidden)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ignores Ctrl-C while processes are started, which they inherit: this one ends them, without their tracebacks."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python delivers signals to the main thread only
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _start_process() -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Ends this process when the one that started it has ended, even by a signal that it could not pass on."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
