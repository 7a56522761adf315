"""How a hub gathers speed once it is free: what its friction is at low speed.

A hub that comes free under a slowly growing torque is held by its sliding friction alone. Where that falls with the
speed it creeps first, where it falls at once it goes off as a parabola does. Only that is compared. When it comes free
is left open, and with it the static level; where it rested, which a sensor tells to a step of its own only; and how
strongly it is pushed, because a link swings for long from what noise has told of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from twin.mechanics.state import Motion
from twin.residuals.prepared import Prepared
from twin.residuals.rest_run import RestRun
from twin.rigs.model import Model

Event = tuple[int, int]
"""Sample at which a motion is first seen, and its direction."""

_GRAIN = 1e-3  # s, instants of a run
_SPARE = 0.06  # s behind the readings that are run, for a run that comes free too late
_TRIES = 10  # levels that are tried until a run comes free when the rig did
_LEAST = 1e-3  # N m/s, growth of a torque below which it is taken for as much
_STEPS = 3  # Gauss-Newton steps of the instant that is left open
_FARTHEST = 0.03  # s by which a run is moved in time


def events(prepared: Prepared, model: Model, motion: Motion) -> tuple[Event, ...]:
    """The break-aways of a recording under a torque that grows slowly."""
    if prepared.hub is None:
        return ()
    runs = {e: RestRun.of(model, prepared, motion, *e) for e in prepared.hub.onsets}
    return tuple(e for e, run in runs.items() if run is not None and run.is_slow)


def residual(
    time: np.ndarray, prepared: Prepared, model: Model, motion: Motion, events: Sequence[Event]
) -> tuple[np.ndarray, np.ndarray]:
    """Readings about break-aways less those of runs that come free at the same instant, in noise units.

    Args:
      time: (m) uniform grid of which each reading takes the nearest instant [s].
      prepared: the recording.
      model: with which it is run.
      motion: of the link under the measured hub, from which runs begin.
      events: see `events`.

    Returns:
      The residual (m), and whether there is one (m). Readings that share an instant are one, with the noise of one.
    """
    total, count = np.zeros(len(time)), np.zeros(len(time))
    for event in events:
        run = RestRun.of(model, prepared, motion, *event)
        assert run is not None
        at = np.round((run.time[1:] - time[0]) / (time[1] - time[0])).astype(int)
        kept = (at >= 0) & (at < len(time))
        np.add.at(total, at[kept], _missing(run)[kept])
        np.add.at(count, at[kept], 1.0)
    return total / np.sqrt(np.maximum(count, 1.0)), count > 0


def _missing(run: RestRun) -> np.ndarray:
    """Readings (n) behind the first instant less those of the model, in noise units."""
    dense = np.arange(run.time[0], run.time[-1] + _SPARE, _GRAIN)
    time, reading = run.time[1:], run.reading[1:]
    gone = run.direction * (reading - reading[: run.end].mean())
    goal = float(np.median(gone[-3:])) / 2
    told, late = _on_time(run, dense, goal, _reached(time, gone, goal))
    return _aligned(time, reading, CubicSpline(dense, told), late) / run.prepared.noise["hub_angle"]


def _on_time(run: RestRun, time: np.ndarray, goal: float, seen: float) -> tuple[np.ndarray, float]:
    """Readings (n) of a run that has come to a goal when it was seen, and by what it is still late [s].

    The higher the level, the later it does; under a command of stairs, by stairs.
    """
    torque, slope = run.borne
    level, slope = torque - run.raised, max(slope, _LEAST)
    early, tardy = run.coulomb, np.inf
    tried: list[tuple[float, float]] = []
    # A run that comes to nothing finite, under an effect far too large, is as one that never comes free.
    best, told = np.inf, np.full(len(time), run.reading[1 : run.end + 1].mean())
    for _ in range(_TRIES):
        readings = run.readings(level, time)
        if not np.isfinite(readings).all():
            break
        late = _reached(time, run.direction * (readings - readings[0]), goal) - seen
        if abs(late) < abs(best):
            best, told = late, readings
        early, tardy = (early, level) if late > 0 else (level, tardy)
        if abs(late) < _GRAIN / 4 or tardy - early < 1e-5 * level:
            break
        if tried and (late - tried[-1][1]) * (level - tried[-1][0]) > 0:
            slope = (level - tried[-1][0]) / (late - tried[-1][1])
        tried.append((level, late))
        level -= slope * late
        if not early < level < tardy:
            level = (early + tardy) / 2 if np.isfinite(tardy) else tried[-1][0] * 1.1
    return told, best if np.isfinite(best) else 0.0


def _reached(time: np.ndarray, gone: np.ndarray, goal: float) -> float:
    """When a way (n) first comes to a goal [s]; the last instant if it never does."""
    first = int(np.argmax(gone > goal))
    if first == 0:
        return float(time[-1])
    return float(np.interp(goal, gone[first - 1 : first + 1], time[first - 1 : first + 1]))


def _aligned(time: np.ndarray, reading: np.ndarray, told: CubicSpline, late: float) -> np.ndarray:
    """What is left of readings (n) by a curve that is moved in time and angle, and stretched, to where it fits best."""
    missing = reading
    for _ in range(_STEPS):
        moved = np.clip(time + late, told.x[0], told.x[-1])
        missing = reading - told(moved)
        columns = np.column_stack([told(moved, 1), np.ones(len(time)), told(moved) - told(told.x[0])])
        change = np.linalg.lstsq(columns, missing, rcond=None)[0]
        missing = missing - columns[:, 1:] @ change[1:]
        late = float(np.clip(late + change[0], -_FARTHEST, _FARTHEST))
    return missing
