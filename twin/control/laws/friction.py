"""Feed-forward compensation of the hub's friction, added to the torque of another controller."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.control.laws.base import Controller

RATE = 0.05
"""Rate of the reference [rad/s] at which the feed-forward is 76 % of the level, tanh(1); chosen."""


class FrictionFeedForward:
    """Adds level * tanh(rate of the reference / RATE) to the torque of another controller.

    The sign is that of the reference's rate instead of the measured one, so that noise does not make it chatter. It is
    meant for smooth references: one that jumps has a rate during a single sample only.
    """

    def __init__(self, inner: Controller, level: float, period: float) -> None:
        """Takes the other controller, the friction level to compensate [N m], and the sample period [s]."""
        self._inner, self._level, self._period = inner, level, period
        self.reset()

    @property
    def states(self) -> dict[str, float]:
        """Added torque [N m], and the states of the other controller."""
        return {"friction_torque": self._added, **getattr(self._inner, "states", {})}

    def reset(self) -> None:
        """Resets the previous reference and the other controller."""
        self._inner.reset()
        self._before: float | None = None
        self._added = 0.0

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        before = reference if self._before is None else self._before
        self._before = reference
        self._added = self._level * math.tanh((reference - before) / self._period / RATE)
        return self._inner.torque(measured, reference) + self._added
