"""Residual of the hub angle just behind break-aways: what friction is like at low speed.

Once it has broken away under a slowly growing torque, the hub is opposed by its sliding friction alone. If that falls
with the speed, the hub creeps first; if it falls at once, the angle grows as a parabola. Only this shape is compared.
Nuisance parameters are left open: the instant of the break-away, and with it the static level; the angle of the rest,
which a quantised sensor shows to one step only; and the torque that accelerates the hub, because the link oscillates
for long with what noise has excited in the model.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from twin.mechanics.state import Motion
from twin.residuals.filters import GRID, REACH
from twin.residuals.numerics import GAUSS_NEWTON_STEPS, MOST_EVALUATIONS
from twin.residuals.prepared import Prepared
from twin.residuals.rest_run import RestRun
from twin.rigs.model import Model

Onset = tuple[int, int]
"""Sample at which a motion of the hub is first visible, and its direction, +1 or -1."""

_MIN_SLOPE = 1e-3  # N m/s, least growth of the torque in the first estimate of the level


def slow_onsets(prepared: Prepared, model: Model, motion: Motion) -> tuple[Onset, ...]:
    """The break-aways of a recording under a slowly growing torque; `motion`: of the link under the measured hub."""
    if prepared.hub is None:
        return ()
    runs = {e: RestRun.of(model, prepared, motion, *e) for e in prepared.hub.onsets}
    return tuple(e for e, run in runs.items() if run is not None and run.is_slow)


def departure_residual(
    time: np.ndarray, prepared: Prepared, model: Model, motion: Motion, onsets: Sequence[Onset]
) -> tuple[np.ndarray, np.ndarray]:
    """Readings of the hub behind break-aways less simulated ones, in multiples of the noise.

    Args:
      time: uniform grid (m) [s].
      prepared: the recording.
      model: to simulate.
      motion: of the link under the measured hub.
      onsets: break-aways, see `slow_onsets`.

    Returns:
      The residual (m), and whether there is one (m). Each reading is assigned to the nearest instant of the grid;
      several at one instant are added and divided by the root of their number, to keep the noise of one reading.
    """
    total, count = np.zeros(len(time)), np.zeros(len(time))
    for onset in onsets:
        run = RestRun.of(model, prepared, motion, *onset)
        assert run is not None
        at = np.round((run.time[1:] - time[0]) / (time[1] - time[0])).astype(int)
        kept = (at >= 0) & (at < len(time))
        np.add.at(total, at[kept], _run_residual(run)[kept])
        np.add.at(count, at[kept], 1.0)
    return total / np.sqrt(np.maximum(count, 1.0)), count > 0


def _run_residual(run: RestRun) -> np.ndarray:
    """Readings behind the first instant of a run less simulated ones (n - 1), in multiples of the noise."""
    # A run may break away too late, so that it is simulated longer than it was read.
    dense = np.arange(run.time[0], run.time[-1] + REACH, GRID / 2)
    time, reading = run.time[1:], run.reading[1:]
    travel = run.direction * (reading - reading[: run.end].mean())
    goal = float(np.median(travel[-3:])) / 2
    simulated, late = _run_on_time(run, dense, goal, _crossing_time(time, travel, goal))
    curve = CubicSpline(dense, simulated)
    return _aligned_residual(time, reading, curve, late) / run.prepared.noise["hub_angle"]


def _run_on_time(run: RestRun, time: np.ndarray, goal: float, instant: float) -> tuple[np.ndarray, float]:
    """Readings of the run whose static level makes it travel a distance by a given instant.

    The higher the level, the later that happens. The level is found by the secant method, safeguarded by bisection.
    Under a command that grows in steps it happens at one of these: then another level that changes nothing ends the
    search within half a step of the instant.

    Args:
      run: the break-away.
      time: instants of the simulation (k) [s].
      goal: distance [rad].
      instant: at which the rig had travelled it [s].

    Returns:
      The simulated readings (k) [rad], and by how much they are still late [s].
    """
    torque, slope = run.holding_torque
    level, slope = torque - run.level_offset, max(slope, _MIN_SLOPE)
    low, high = run.coulomb, np.inf
    half_step, near = run.prepared.recording.period / 2, GRID / 8
    tried: list[tuple[float, float]] = []
    # A simulation that diverges, under an effect far too large, counts as one that never breaks away.
    best, simulated = np.inf, np.full(len(time), run.reading[1 : run.end + 1].mean())
    for _ in range(MOST_EVALUATIONS):
        readings = run.readings(level, time)
        if not np.isfinite(readings).all():
            break
        late = _crossing_time(time, run.direction * (readings - readings[0]), goal) - instant
        if abs(late) < abs(best):
            best, simulated = late, readings
        low, high = (low, level) if late > 0 else (level, high)
        in_steps = bool(tried) and abs(late - tried[-1][1]) < near
        if abs(late) < (half_step if in_steps else near) or high - low < 1e-5 * level:
            break
        if tried and (late - tried[-1][1]) * (level - tried[-1][0]) > 0:
            slope = (level - tried[-1][0]) / (late - tried[-1][1])
        tried.append((level, late))
        level -= slope * late
        if not low < level < high:
            level = (low + high) / 2 if np.isfinite(high) else tried[-1][0] * 1.1
    return simulated, best if np.isfinite(best) else 0.0


def _crossing_time(time: np.ndarray, values: np.ndarray, goal: float) -> float:
    """When a signal (n) first exceeds a value [s], linearly interpolated; the last instant if it never does."""
    first = int(np.argmax(values > goal))
    if first == 0:
        return float(time[-1])
    return float(np.interp(goal, values[first - 1 : first + 1], time[first - 1 : first + 1]))


def _aligned_residual(time: np.ndarray, reading: np.ndarray, curve: CubicSpline, late: float) -> np.ndarray:
    """Readings (n) less a simulated curve that is shifted in time and angle, and stretched, by least squares [rad].

    Args:
      time: of the readings (n) [s].
      reading: (n) [rad].
      curve: simulated reading over time.
      late: first shift of the curve [s].
    """
    residual, first, last = reading, curve.x[0], curve.x[-1]
    at_first = curve(first)
    for _ in range(GAUSS_NEWTON_STEPS):
        moved = np.clip(time + late, first, last)
        simulated = curve(moved)
        residual = reading - simulated
        columns = np.column_stack([curve(moved, 1), np.ones(len(time)), simulated - at_first])
        change = np.linalg.lstsq(columns, residual, rcond=None)[0]
        residual = residual - columns[:, 1:] @ change[1:]
        late = float(np.clip(late + change[0], -REACH / 2, REACH / 2))
    return residual
