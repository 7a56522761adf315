"""Processes that compute residuals together with the one that asks for them, and threads for all else.

A residual takes more time in Python, of which threads of one process run one at a time, than in compiled simulations.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from threadpoolctl import threadpool_limits

from twin import effects
from twin.executors.memory import return_large_arrays
from twin.executors.processes import new_process
from twin.mechanics.state import Start
from twin.residuals.numerics import ROUNDING
from twin.residuals.prepared import Prepared
from twin.rigs.model import Model

_KEPT = 2
"""Data that a process keeps, those used last: of a fit, and driven ones beside free runs."""

Task = tuple[int, Model, Start]
"""Index of a recording, the model to simulate, the initial state."""
Parts = dict[str, np.ndarray]
"""Channel -> residual (m) of a recording."""
T = TypeVar("T")
ItemT = TypeVar("ItemT")


class ResidualData(Protocol):
    """Recordings whose residuals can be computed, here or in another process.

    Attributes:
      prepared: the recordings.
    """

    prepared: tuple[Prepared, ...]

    def residual(self, model: Model, i: int, start: Start) -> Parts:
        """Channel -> residual (m) of recording i, in multiples of the noise, 0 where unknown."""


class ResidualPool(ThreadPoolExecutor):
    """`count` threads, and `count` - 1 processes that compute residuals together with the thread that asks for them."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        return_large_arrays()
        self._seconds: WeakKeyDictionary[ResidualData, dict[int, float]] = WeakKeyDictionary()
        self._helpers = [_idle_or_new() for _ in range(count - 1)] if _may_have_helpers() else []

    def residuals(self, data: ResidualData, tasks: Sequence[Task]) -> list[Parts]:
        """The residual of each task, in their order."""
        own, *others = _split(tasks, self._expected_times(data, tasks), 1 + len(self._helpers))
        running = [
            (share, helper.submit(data, [tasks[k] for k in share]))
            for helper, share in zip(self._helpers, others, strict=True)
            if share
        ]
        done = dict(zip(own, _compute(data, [tasks[k] for k in own]), strict=True))
        for share, future in running:
            try:
                computed = future.result()
            except BrokenProcessPool:  # the process has ended
                computed = _compute(data, [tasks[k] for k in share])
            done.update(zip(share, computed, strict=True))
        self._learn_times(data, [(tasks[k][0], seconds) for k, (_, seconds) in done.items()])
        return [done[k][0] for k in range(len(tasks))]

    def spread(
        self,
        function: Callable[[ItemT, ResidualPool], T],
        items: Sequence[ItemT],
        times: Sequence[float] = (),
    ) -> list[T]:
        """The result of a function of each item and a pool of one, here and in the processes, as these become free.

        Args:
          function: of a module, which a process can import.
          items: what it is computed of.
          times: that each is expected to take, in proportion: the longest begins. Without them the first does.
        """
        order = sorted(range(len(items)), key=lambda k: -times[k]) if times else range(len(items))
        waiting, results = deque(order), dict[int, T]()

        def work(compute: Callable[[Callable[[ItemT, ResidualPool], T], ItemT], T]) -> None:
            while True:
                try:
                    k = waiting.popleft()
                except IndexError:
                    return
                results[k] = compute(function, items[k])

        others = [self.submit(work, helper.call) for helper in self._helpers]
        work(_call)
        for other in others:
            other.result()
        return [results[k] for k in range(len(items))]

    def _learn_times(self, data: ResidualData, taken: Sequence[tuple[int, float]]) -> None:
        """Keeps the mean time [s] of the tasks of each recording, half of it that of the last ones."""
        known = self._seconds.setdefault(data, {})
        for i in {i for i, _ in taken}:
            mean = float(np.mean([seconds for j, seconds in taken if j == i]))
            known[i] = (mean + known.get(i, mean)) / 2

    def _expected_times(self, data: ResidualData, tasks: Sequence[Task]) -> np.ndarray:
        """Time that each task will take, in proportion: as learnt, else the length of its recording."""
        seconds = self._seconds.get(data, {})
        if all(i in seconds for i, _, _ in tasks):
            return np.array([seconds[i] for i, _, _ in tasks])
        return np.array([data.prepared[i].recording.duration for i, _, _ in tasks])

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the threads; the processes are kept for the next pool."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        while self._helpers:
            self._helpers.pop().release()


def _split(tasks: Sequence[Task], times: np.ndarray, shares: int) -> list[list[int]]:
    """Indices of the tasks in `shares` parts that take about the same time, given that of each task.

    The tasks of a recording stay together, and with the same part from one call to the next, as far as this allows:
    motions that are simulated for one of them serve others, see `twin.residuals.cache`.
    """
    order = sorted(range(len(tasks)), key=lambda k: tasks[k][0])
    middle = np.cumsum(times[order]) - times[order] / 2
    share = np.minimum(np.floor(middle / max(times.sum(), ROUNDING) * shares), shares - 1)
    return [[k for k, s in zip(order, share, strict=True) if s == part] for part in range(shares)]


def _compute(data: ResidualData, tasks: Sequence[Task]) -> list[tuple[Parts, float]]:
    """The residual of each task, and the time that it took [s]."""
    done = []
    for i, model, start in tasks:
        began = time.perf_counter()
        done.append((data.residual(model, i, start), time.perf_counter() - began))
    return done


def _call(function: Callable[[ItemT, ResidualPool], T], item: ItemT) -> T:
    """The result of a function of an item and a pool of one thread."""
    with threadpool_limits(1), ResidualPool(1) as pool:
        return function(item, pool)


class _Helper:
    """A process that computes residuals, and the data that it keeps."""

    def __init__(self) -> None:
        self._process: ProcessPoolExecutor = new_process()
        self._kept: OrderedDict[int, None] = OrderedDict()
        self._order = threading.Lock()

    def submit(self, data: ResidualData, tasks: list[Task]) -> Future[list[tuple[Parts, float]]]:
        """The residuals of some tasks to come; the data are sent along if the process does not keep them."""
        with self._order:  # both sides forget data in the order in which they were used
            key = _key(data)
            known = key in self._kept
            _remember(self._kept, key, None)
            try:
                return self._process.submit(_compute_kept, key, None if known else data, tasks)
            except BrokenProcessPool as error:
                ended: Future[list[tuple[Parts, float]]] = Future()
                ended.set_exception(error)
                return ended

    def call(self, function: Callable[[ItemT, ResidualPool], T], item: ItemT) -> T:
        """The result of a function, see `ResidualPool.spread`."""
        try:
            return self._process.submit(_call, function, item).result()
        except BrokenProcessPool:  # the process has ended
            return _call(function, item)

    def release(self) -> None:
        """Makes the process forget its data, and offers it to the next pool."""
        with self._order:
            self._kept.clear()
            try:
                self._process.submit(_forget)
            except BrokenProcessPool:
                return
        _idle.append(self)


_idle: list[_Helper] = []
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a child cannot use its parent's processes


def _may_have_helpers() -> bool:
    """Whether processes can be started, and know all that this one does."""
    # Effects that a running script has registered are not known there; a daemon may not start processes.
    return effects.all_on_import() and not multiprocessing.current_process().daemon


def _idle_or_new() -> _Helper:
    try:
        return _idle.pop()
    except IndexError:
        return _Helper()


_keys: WeakKeyDictionary[ResidualData, int] = WeakKeyDictionary()
_numbers = itertools.count()


def _key(data: ResidualData) -> int:
    """A number that no other data of this process ever have."""
    return _keys.setdefault(data, next(_numbers))


def _remember(kept: OrderedDict[int, T], key: int, value: T) -> None:
    """Adds an entry as the one used last, and drops the one that has not been used for longest."""
    kept[key] = value
    kept.move_to_end(key)
    while len(kept) > _KEPT:
        kept.popitem(last=False)


# In a helper's process:
_received: OrderedDict[int, ResidualData] = OrderedDict()


def _compute_kept(key: int, data: ResidualData | None, tasks: Sequence[Task]) -> list[tuple[Parts, float]]:
    if data is not None:
        threadpool_limits(1)  # processes run side by side: more threads of linear algebra make them slower
    _remember(_received, key, _received[key] if data is None else data)
    return _compute(_received[key], tasks)


def _forget() -> None:
    _received.clear()
