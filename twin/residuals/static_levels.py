"""Static friction levels by runs that begin in a measured rest: the level at which they leave it as the rig did.

Where a torque grows slowly, the instant of a break-away tells its level; a hub that has just come free gains speed so
quickly that a few readings behind it tell that instant better than a sample period. Nothing else that sticks or slips
enters: what the link does until then follows from the measured hub, and the run ends before that comes to rest again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.mechanics.state import Start
from twin.residuals.data import DrivenData
from twin.residuals.rest_run import BEFORE, INSTANT, REST, RestRun
from twin.residuals.view import View, move
from twin.rigs.model import Model

_LATE, _OFF = 0.02, 0.005  # s by which the instant, and part by which the torque, may have been misread
_STEPS = 41  # levels that are tried, twice
_LIKELY = 2.0  # log likelihood below the best up to which a level is within two standard errors
_FOLLOWED = 2.0  # noise levels up to which a run follows the rig
_APART = 5.0  # standard errors by which two levels differ for sure
_SLIPS = 0.01
"""Relative error of a level beside a play: a hub first slips by less than is seen and leaves the flank that pushes it,
so that it is seen to come free at up to 2 % more (virtual rig, flanks of 1000 N m/rad; tests/test_hub_friction.py)."""


@dataclass(frozen=True)
class Level:
    """A static level [N m] and its standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class Release:
    """A rest that ended: recording, last sample at which the hub surely rested [s], direction, the plant's level."""

    recording: int
    time: float
    direction: int
    level: Level


def levels(data: DrivenData, model: Model, starts: Sequence[Start]) -> dict[int, Level]:
    """Static level by direction, +1 and -1, where the recordings show it.

    A rest that ends below what friction bore elsewhere was none: the hub had only been slow. Recordings that began in
    motion count where no others show any: how their link swings hangs on a first state that was estimated.
    """
    read = releases(data, model, starts)
    surely = [r for r in read if data.prepared[r.recording].recording.start == "rest"]
    read = surely or read
    seen = {direction: [r.level for r in read if r.direction == direction] for direction in (1, -1)}
    return {direction: together(levels) for direction, levels in seen.items() if levels}


def releases(data: DrivenData, model: Model, starts: Sequence[Start]) -> list[Release]:
    """The static level at the end of each rest that tells it; the model's other numbers are taken as true."""
    read = []
    for i, run in runs(data, model, starts):
        level = _level(run, _pull(data.views[i], run.end_of_rest))
        if level is not None:
            read.append(Release(i, run.end_of_rest, run.direction, level))
    return read


def runs(data: DrivenData, model: Model, starts: Sequence[Start]) -> Iterator[tuple[int, RestRun]]:
    """Each rest that ends, with the index of its recording; the link moves as the measured hub has moved it."""
    for i, (prepared, view, start) in enumerate(zip(data.prepared, data.views, starts, strict=True)):
        if prepared.hub is None:
            continue
        motion, _ = move(view, prepared, model, start)
        for onset, direction in prepared.hub.onsets:
            run = RestRun.of(model, prepared, motion, onset, direction)
            if run is not None:
                yield i, run


def together(seen: Sequence[Level]) -> Level:
    """One level of several: the mean of those that do not lie clearly below another."""
    highest = max(seen, key=lambda level: level.value - _APART * level.error)
    kept = [
        level for level in seen if highest.value - level.value < _APART * np.hypot(highest.error, level.error)
    ]
    weights = np.array([1 / level.error**2 for level in kept])
    value = float(weights @ [level.value for level in kept] / weights.sum())
    return Level(value, float(1 / np.sqrt(weights.sum())))


def _pull(view: View, end: float) -> float:
    """Standard deviation of the link's pull at the hub in the rest that ends at an instant [N m]."""
    rest = (view.time > end - REST) & (view.time < end - BEFORE)
    return float(np.sqrt(np.mean(view.pull[rest] ** 2)))


def _level(run: RestRun, pull: float) -> Level | None:
    """The level at which a run follows the rig; None where none does, or the torque that friction bore jumped.

    A link that swings on pulls at the hub by a little more or less than the measured hub has moved it to, by `pull`
    [N m].
    """
    if not run.is_slow:
        return None
    torque, slope = run.borne
    centre = torque - run.raised
    half = max(slope * _LATE, _OFF * centre)
    for _ in range(2):
        values = centre + np.linspace(-half, half, _STEPS)
        # Below the Coulomb level a hub that has come free would rest and go on without end.
        values = values[values > run.coulomb]
        if not len(values):
            return None
        costs = np.array([_cost(run, value) for value in values])
        likely = values[costs < costs.min() + _LIKELY]
        centre, half = float(likely.mean()), float(np.ptp(likely)) / 2 + 2 * half / (_STEPS - 1)
    if costs.min() > _FOLLOWED**2 * len(run.time) / 2:
        return None
    # Commands rise by stairs: between two of them all levels are alike.
    error = max(float(np.ptp(likely)) / np.sqrt(12), 2 * half / (_STEPS - 1))
    slips = _SLIPS * centre if run.model.plant.motor.gap > 0 else 0.0
    return Level(centre, float(np.linalg.norm([error, slope * INSTANT, slips, pull])))


def _cost(run: RestRun, level: float) -> float:
    """Minus the log likelihood of the readings under a static level [N m]."""
    missing = (run.reading - run.readings(level, run.time)) / run.prepared.noise["hub_angle"]
    return 0.5 * float(np.nansum(missing**2))
