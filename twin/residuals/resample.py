"""Interpolation of the channels of a recording on a uniform grid, gaps filled."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicHermiteSpline, CubicSpline, LSQUnivariateSpline

from twin.recording import Recording, gaps_in
from twin.residuals.cell_means import CELLS
from twin.residuals.filters import GRID
from twin.residuals.prepared import MIN_READINGS
from twin.rigs.model import Model

_MAX_SPACING = 1.8
"""Sample periods between two readings beyond which the values between them are taken as unknown."""
_SIDE_SPAN, _DEGREE = 0.025, 6
"""Of that polynomial: span to either side [s], which has `MIN_READINGS` at least, and its degree."""


def resample_channel(recording: Recording, channel: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A channel at the instants of a grid (m), and whether its readings are there (m).

    See `spline`; for the motor torque `resample_torque`.
    """
    values = recording[channel]
    ok = np.isfinite(values)
    at, values, period = recording.time[ok], values[ok], recording.period
    behind = np.clip(np.searchsorted(at, time, side="right"), 1, len(at) - 1)
    dense = at[behind] - at[behind - 1] < _MAX_SPACING * period
    met = np.minimum(np.abs(time - at[behind - 1]), np.abs(at[behind] - time)) < 1e-6
    known = (dense | met) & (time < at[-1] + period) & (time > at[0] - period)
    if channel == "motor_torque":
        return resample_torque(at, values, period, time), known
    return spline(*_with_gaps_filled(at, values, period), period)(np.clip(time, at[0], at[-1])), known


def resample_torque(at: np.ndarray, values: np.ndarray, period: float, time: np.ndarray) -> np.ndarray:
    """The torque of a motor, which jumps with its command, at the instants of a grid (m), from readings (k).

    Linear between readings that are not denser than the grid. A measured and a simulated torque pass the same.
    """
    if _readings_per_knot(period) == 1:
        return np.interp(time, at, values)
    return spline(at, values, period)(np.clip(time, at[0], at[-1]))


def spline(at: np.ndarray, values: np.ndarray, period: float) -> CubicSpline | LSQUnivariateSpline:
    """Cubic spline through readings; of readings denser than the grid the least-squares one with fewer knots.

    Readings picked from an interpolating spline would keep all of their noise, at whatever rate they were taken: what
    is above the band of the grid would fold back into it. The projection on splines averages it out.
    """
    every = _readings_per_knot(period)
    if every == 1:
        return CubicSpline(at, values)
    return LSQUnivariateSpline(at, values, at[every:-every:every])


def _readings_per_knot(period: float) -> int:
    """Readings in a step of the grid, rounded up; a quarter of one more counts for none, as with jitter."""
    return max(1, math.ceil(GRID / period - 1 / 4))


def resample_hub_angle(model: Model, recording: Recording, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The hub angle at the instants of a grid (m) [rad], and whether its readings are there (m).

    The hub's acceleration jumps with the command. The angle that the command alone would give the hub, without link
    and friction, is subtracted before interpolation and added afterwards.
    """
    step = float(time[1] - time[0]) / CELLS
    fine = np.arange(recording.time[0] - step, recording.time[-1] + 2 * step, step)
    rate = model.drive(recording).impulse(fine) / model.rig["hub_inertia"]
    angle = np.r_[0.0, np.cumsum((rate[1:] + rate[:-1]) / 2 * step)]
    commanded = CubicHermiteSpline(fine, angle, rate)
    smooth = recording["hub_angle"] - commanded(recording.time)
    rest, known = resample_channel(
        recording.replace(channels={**recording.channels, "hub_angle": smooth}), "hub_angle", time
    )
    return rest + commanded(np.clip(time, recording.time[0], recording.time[-1])), known


def gaps_of(recording: Recording, channel: str) -> list[tuple[float, float]]:
    """First and last instant of each span without readings of a channel that a polynomial fills [s]."""
    return _spans(recording.time[np.isfinite(recording[channel])], recording.period)


def missing_rows(recording: Recording) -> list[tuple[float, float]]:
    """First and last instant of each span without any row, in which the command is unknown [s]."""
    return _spans(recording.time, recording.period)


def _spans(at: np.ndarray, period: float) -> list[tuple[float, float]]:
    return [(float(at[g]), float(at[g + 1])) for g in gaps_in(at, period)]


def _with_gaps_filled(time: np.ndarray, values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants and values of known samples (n), with gaps filled by the polynomial fitted to both sides."""
    side = max(MIN_READINGS, round(_SIDE_SPAN / period))
    pieces_t, pieces_v = [time], [values]
    for g in gaps_in(time, period):
        beside = slice(max(0, g - side + 1), g + 1 + side)
        degree = min(_DEGREE, len(time[beside]) // 2)
        inside = np.arange(time[g] + period, time[g + 1] - period / 2, period)
        pieces_t.append(inside)
        pieces_v.append(Polynomial.fit(time[beside], values[beside], degree)(inside))
    order = np.argsort(np.concatenate(pieces_t), kind="stable")
    return np.concatenate(pieces_t)[order], np.concatenate(pieces_v)[order]
