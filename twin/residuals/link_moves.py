"""Motions of the link under a measured hub, kept for models that move it alike.

Candidates that act on drive and hub alone move the link exactly as the model they are added to: its motion depends on
`twin.mechanics.plant.Link`, on the motion of the hub and on its first state, and on nothing else. What is kept is found
again by comparing these values, not by a digest of them.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable

import numpy as np

Moved = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Angles (m, n + 1) [rad] and rates (m, n + 1) [rad/s] of the link, torque on the hub (m) [N m]."""


class LinkMoves:
    """The last motions of a link, by what they depend on; shared by threads."""

    def __init__(self, most: int) -> None:
        """Keeps so many motions."""
        self._most = most
        self._known: OrderedDict[Hashable, Moved] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, on: Iterable[float | np.ndarray], simulate: Callable[[], Moved]) -> Moved:
        """The motion that depends on these numbers and arrays, simulated where it is not known."""
        key = tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in on)
        with self._lock:
            known = self._known.get(key)
        if known is None:
            known = simulate()
            with self._lock:
                self._known[key] = known
                while len(self._known) > self._most:
                    self._known.popitem(last=False)
        return known

    def __reduce__(self):
        # A copy in another process begins empty.
        return LinkMoves, (self._most,)
