"""Processes of this machine that run tasks, and end with the one that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, TypeVar

from twin.executors.memory import return_large_arrays

T = TypeVar("T")
MOST_PROCESSES = 1024
"""On one machine; the largest have some hundred processors."""


class _Processes(Executor):
    """Processes with a thread each that hands it tasks: one that ends takes its task along, and is replaced."""

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count)
        self._free: SimpleQueue[ProcessPoolExecutor] = SimpleQueue()
        self._wanted = True
        for _ in range(count):
            self._free.put(new_process())

    def submit(self, task: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        return self._threads.submit(self._run, task, given, named)

    def _run(self, task: Callable[..., T], given: tuple[Any, ...], named: dict[str, Any]) -> T:
        process = self._free.get()
        try:
            return process.submit(task, *given, **named).result()
        except BrokenProcessPool:
            if self._wanted:
                process = new_process()
            raise
        finally:
            self._free.put(process)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._wanted = False
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        while not self._free.empty():
            self._free.get().shutdown(wait)


@contextmanager
def processes(count: int) -> Iterator[Executor]:
    """Yields an executor of so many processes; where its block raises, they are ended at once."""
    others = multiprocessing.active_children()
    pool = _Processes(count)
    try:
        yield pool
    except BaseException:
        # What they compute is not wanted any more: do not wait for it.
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


_starting = threading.Lock()


def new_process() -> ProcessPoolExecutor:
    """A process that has been started, without the script that runs, and deaf to Ctrl-C."""
    # "spawn": a forked process may deadlock, because numerical libraries have started threads.
    process = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _start_process)
    with _starting, _script_hidden(), _interrupts_ignored():
        process.submit(os.getpid)
    return process


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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # one that replaces another is started from a thread
    return_large_arrays()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Ends this process when the one that started it has ended, even by a signal that it could not pass on."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
