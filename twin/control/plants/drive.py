"""The drive of a plant: commands, sample by sample, limited by the amplifier and changed by effects on the drive."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from twin.effects import REGISTRY, Drive
from twin.rigs.model import Model

_NO_TIME = 1e-12  # s, remainder of a span by rounding


class DriveLine:
    """Turns commands into delivered torques, delayed ones included.

    A first-order lag is not included, as it is a state of the plant.
    """

    def __init__(self, model: Model) -> None:
        """Takes the model, for its torque limit, effects and patch."""
        self._limit = float(model.declared["torque_limit"])
        self._effects, self._patch = model.effects, model.patch
        self._pending: deque[tuple[float, float]] = deque()
        self._torque = 0.0
        self.reset()

    @property
    def torque(self) -> float:
        """Present delivered torque before any lag [N m]."""
        return self._torque

    def reset(self) -> None:
        """Discards all commands; until the first one acts, the torque is that of a zero command."""
        self._pending.clear()
        self._torque = self._through(0.0, 0.0).before

    def command(self, time: float, torque: float) -> None:
        """Accepts a command [N m] given at `time` [s]."""
        drive = self._through(time, min(max(torque, -self._limit), self._limit))
        self._pending.append((float(drive.time[0]), float(drive.torque[0])))

    def constant_spans(self, start: float, span: float) -> Iterator[tuple[float, float]]:
        """Yields torque [N m] and length [s] of each interval of constant torque within a span [s]."""
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
