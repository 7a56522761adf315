"""Cache of parts of a simulation that many models share.

Candidates that act on drive and hub alone move the link exactly as the model that they are added to: its motion depends
on `twin.mechanics.plant.Link`, the motion of the hub and the initial state alone. So the sensors of the link read the
same. Models that differ in the rig alone have the same drive. Entries are found by comparing these values, not a hash
of them.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from typing import Generic, TypeVar

import numpy as np

LinkMotion = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Angles (m, n + 1) [rad] and rates (m, n + 1) [rad/s] of the segments, required torque on the hub (m) [N m]."""
T = TypeVar("T")
_MOST = 3
"""Results that are kept. With 12 in place of 3 a diagnosis takes as long, and 130 MiB more, see
benchmarks/results/where_time_goes.md."""


class Cache(Generic[T]):
    """The last results by their inputs; safe to share between threads."""

    def __init__(self, most: int = _MOST) -> None:
        """Keeps at most this number of results and drops the one that was not used for longest."""
        self._most = most
        self._known: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, inputs: Iterable[float | str | np.ndarray], compute: Callable[[], T]) -> T:
        """The result with these inputs, computed if it is not in the cache."""
        key = tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in inputs)
        with self._lock:
            known = self._known.get(key)
            if known is not None:
                self._known.move_to_end(key)
        if known is None:
            known = compute()
            with self._lock:
                self._known[key] = known
                while len(self._known) > self._most:
                    self._known.popitem(last=False)
        return known

    def __reduce__(self):
        # A copy in another process begins empty.
        return Cache, (self._most,)
