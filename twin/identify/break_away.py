"""The static friction of the hub, by slowly rising torques: what it bore at the instants at which it first moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin import breakaway
from twin.breakaway import BreakAway
from twin.fit import Prepared
from twin.identify.results import Estimate, pooled
from twin.model import Model, Start

_INSTANT = 5e-3  # s, standard deviation of the instant of a break-away seen in a noisy angle
_MODEL = 1.5e-3  # relative standard deviation of the torque that the model says the link takes from the drive


@dataclass(frozen=True)
class StaticFriction:
    """Break-aways and the level of each direction.

    Attributes:
      events: each break-away that the recordings show well.
      errors: standard error of the torque of each [N m].
      by_direction: +1 or -1 -> level [N m].
      level: both directions together; None where there is no event.
      angle_spread: standard deviation of the levels over the angles at which they were read [N m]; NaN below three.
    """

    events: tuple[BreakAway, ...]
    errors: tuple[float, ...]
    by_direction: dict[int, Estimate]
    level: Estimate | None
    angle_spread: float


def read(model: Model, prepared: Sequence[Prepared], starts: Sequence[Start]) -> StaticFriction:
    """Reads the static friction from every slow approach to a break-away."""
    events = tuple(breakaway.find(model, prepared, starts))
    errors = tuple(math.hypot(e.slope * _INSTANT, _MODEL * abs(e.torque)) for e in events)
    seen = [Estimate(abs(e.torque), s) for e, s in zip(events, errors, strict=True)]
    by_direction = {}
    for direction in (1, -1):
        mine = [s for e, s in zip(events, seen, strict=True) if e.direction == direction]
        if mine:
            by_direction[direction] = pooled(mine)
    level = pooled(seen) if seen else None
    spread = float(np.std([s.value for s in seen], ddof=1)) if len(seen) > 2 else math.nan
    return StaticFriction(events, errors, by_direction, level, spread)
