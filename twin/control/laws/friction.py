"""Feed-forward of friction: the torque that the hub's friction will take, added to what a controller asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.control.laws.base import Controller

RATE = 0.05
"""Rate of the reference [rad/s] at which the feed-forward has reached 76 % of the level: tanh(1)."""


class FrictionFeedForward:
    """Adds level * tanh(rate of the reference / RATE) to the torque of another controller.

    The reference, not the measured rate, decides the sign: noise cannot make it chatter. A reference that
    jumps has a rate for one sample only; a smooth one is meant.
    """

    def __init__(self, inner: Controller, level: float, period: float) -> None:
        """Takes the controller, the level to make up for [N m], and the sample period [s]."""
        self._inner, self._level, self._period = inner, level, period
        self.reset()

    @property
    def states(self) -> dict[str, float]:
        """Torque that is added [N m], and the states of the controller."""
        return {"friction_torque": self._added, **getattr(self._inner, "states", {})}

    def reset(self) -> None:
        """Forgets the reference."""
        self._inner.reset()
        self._before: float | None = None
        self._added = 0.0

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        before = reference if self._before is None else self._before
        self._before = reference
        self._added = self._level * math.tanh((reference - before) / self._period / RATE)
        return self._inner.torque(measured, reference) + self._added
