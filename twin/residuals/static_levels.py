"""Static friction levels from the ends of rests: the level at which a simulation leaves the rest as the rig did.

Where a torque grows slowly, the instant of the break-away determines the level. The hub accelerates so fast that a few
readings behind the break-away determine that instant better than a sample period. See `rest_run` for the simulations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from twin.mechanics.state import Start
from twin.residuals.data import DrivenData
from twin.residuals.filters import REACH
from twin.residuals.rest_run import INSTANT_ERROR, LEAD_SPAN, MAX_LEVEL_ERROR, REST_SPAN, RestRun
from twin.residuals.significance import CERTAIN, FOLLOWS
from twin.residuals.view import View, move_link
from twin.rigs.model import Model

_GRID_POINTS = 41  # levels of each of two grids
TWO_SIGMA = 2.0
"""Log likelihood below the maximum up to which a level is within two standard errors."""
_BACKLASH_ERROR = 0.01
"""Relative error of a level where there is a backlash: the hub first slips by less than is visible and leaves the flank
that pushes it, so that it seems to break away at up to 2 % more (virtual rig, flanks of 1000 N m/rad;
tests/residuals/test_hub_friction.py)."""


@dataclass(frozen=True)
class Level:
    """A static friction level [N m] and its standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class LevelReading:
    """The static level at the end of one rest.

    Attributes:
      recording: index.
      time: last instant at rest [s].
      direction: of the motion behind it, +1 or -1.
      level: without position dependence.
    """

    recording: int
    time: float
    direction: int
    level: Level


def levels(data: DrivenData, model: Model, starts: Sequence[Start]) -> dict[int, Level]:
    """Static level of each direction, +1 and -1, that has a break-away under a slowly growing torque.

    Readings that lie clearly below another one are dropped, see `combined_level`. Recordings that began in motion are
    used only if there are no others: the motion of their link depends on an estimated initial state.
    """
    readings = level_readings(data, model, starts)
    from_rest = [r for r in readings if data.prepared[r.recording].recording.start == "rest"]
    readings = from_rest or readings
    by_direction = {
        direction: [r.level for r in readings if r.direction == direction] for direction in (1, -1)
    }
    return {direction: combined_level(levels) for direction, levels in by_direction.items() if levels}


def level_readings(data: DrivenData, model: Model, starts: Sequence[Start]) -> list[LevelReading]:
    """The static level at the end of each rest that determines it, other parameters being those of the model."""
    readings = []
    for i, run in rest_runs(data, model, starts):
        level = _level(run, _link_torque_noise(data.views[i], run.end_of_rest))
        if level is not None:
            readings.append(LevelReading(i, run.end_of_rest, run.direction, level))
    return readings


def rest_runs(data: DrivenData, model: Model, starts: Sequence[Start]) -> Iterator[tuple[int, RestRun]]:
    """The index of the recording and the run of each rest that ends, the link moved by the measured hub before."""
    for i, (prepared, view, start) in enumerate(zip(data.prepared, data.views, starts, strict=True)):
        if prepared.hub is None:
            continue
        motion, _ = move_link(view, prepared, model, start)
        for onset, direction in prepared.hub.onsets:
            run = RestRun.of(model, prepared, motion, onset, direction)
            if run is not None:
                yield i, run


def combined_level(readings: Sequence[Level]) -> Level:
    """Weighted mean of levels that do not contradict the highest one.

    A break-away clearly below another one was none: the hub had been creeping.
    """
    highest = max(readings, key=lambda level: level.value - CERTAIN * level.error)
    kept = [
        level
        for level in readings
        if highest.value - level.value < CERTAIN * np.hypot(highest.error, level.error)
    ]
    weights = np.array([1 / level.error**2 for level in kept])
    value = float(weights @ [level.value for level in kept] / weights.sum())
    return Level(value, float(1 / np.sqrt(weights.sum())))


def _link_torque_noise(view: View, end: float) -> float:
    """Standard deviation of the link's torque on the hub by noise, in the rest that ends at an instant [N m]."""
    rest = (view.time > end - REST_SPAN) & (view.time < end - LEAD_SPAN)
    return float(np.sqrt(np.mean(view.link_torque_noise[rest] ** 2)))


def _level(run: RestRun, link_torque_noise: float) -> Level | None:
    """The most likely static level of a run, by two grids.

    Args:
      run: the break-away.
      link_torque_noise: standard deviation of the torque of the link, which the noise of the measured hub made
        oscillate [N m].

    Returns:
      None if the torque does not grow slowly, or no level makes the run follow the rig.
    """
    if not run.is_slow:
        return None
    torque, slope = run.holding_torque
    centre = torque - run.level_offset
    half = max(slope * REACH, MAX_LEVEL_ERROR * centre) / 2
    for _ in range(2):
        values = centre + np.linspace(-half, half, _GRID_POINTS)
        # A static level below the Coulomb level would stop the hub at once, again and again.
        values = values[values > run.coulomb]
        if not len(values):
            return None
        costs = np.array([_cost(run, value) for value in values])
        likely = values[costs < costs.min() + TWO_SIGMA]
        centre, half = float(likely.mean()), float(np.ptp(likely)) / 2 + 2 * half / (_GRID_POINTS - 1)
    if costs.min() > FOLLOWS**2 * len(run.time) / 2:
        return None
    # Under a command of steps, levels between the torques of two steps are equally likely.
    error = max(float(np.ptp(likely)) / np.sqrt(12), 2 * half / (_GRID_POINTS - 1))
    slip = _BACKLASH_ERROR * centre if run.model.plant.motor.gap > 0 else 0.0
    return Level(centre, float(np.linalg.norm([error, slope * INSTANT_ERROR, slip, link_torque_noise])))


def _cost(run: RestRun, level: float) -> float:
    """Negative log likelihood of the readings of a run under a static level [N m], up to a constant."""
    residual = (run.reading - run.readings(level, run.time)) / run.prepared.noise["hub_angle"]
    return 0.5 * float(np.nansum(residual**2))
