"""The drive of a plant: commands as they come, saturated, then through the effects of the drive."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from twin.effects import REGISTRY, Drive
from twin.rigs.model import Model

_NO_TIME = 1e-12  # s, what rounding leaves of a span


class DriveLine:
    """Turns a command at a time into the torques that a plant feels from then on.

    Any lag is left to the plant: it is a state.
    """

    def __init__(self, model: Model) -> None:
        self._limit = float(model.declared["torque_limit"])
        self._effects, self._patch = model.effects, model.patch
        self._pending: deque[tuple[float, float]] = deque()
        self._torque = 0.0
        self.reset()

    @property
    def torque(self) -> float:
        """Torque [N m] that is delivered now, before any lag."""
        return self._torque

    def reset(self) -> None:
        """Forgets all commands: until the first one acts, none was given."""
        self._pending.clear()
        self._torque = self._through(0.0, 0.0).before

    def command(self, time: float, torque: float) -> None:
        """Takes a command [N m] given at `time` [s]."""
        drive = self._through(time, min(max(torque, -self._limit), self._limit))
        self._pending.append((float(drive.time[0]), float(drive.torque[0])))

    def constant_spans(self, start: float, span: float) -> Iterator[tuple[float, float]]:
        """Yields torque [N m] and length [s] of each stretch of constant torque within a span [s]."""
        now, end = start, start + span
        while now < end - _NO_TIME:
            while self._pending and self._pending[0][0] <= now + _NO_TIME:
                self._torque = self._pending.popleft()[1]
            until = min(end, self._pending[0][0]) if self._pending else end
            yield self._torque, until - now
            now = until

    def _through(self, time: float, torque: float) -> Drive:
        drive = Drive(np.array([time]), np.array([torque]))
        for name, p in self._effects.items():
            drive = REGISTRY[name].drive(drive, p)
        return drive if self._patch is None else drive.replace(torque=self._patch.on_command(drive.torque))
