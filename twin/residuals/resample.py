"""Readings of a recording on a uniform grid, missing ones bridged by what is smooth in them."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from twin.recording import Recording
from twin.rigs.model import Model

_SPARSE = 1.8
"""Sample periods between two readings beyond which nothing is known of what lies between."""
_GAP = 2.5  # sample periods beyond which a polynomial bridges missing samples
_BESIDE, _FEWEST, _DEGREE = 0.025, 4, 6  # s on either side that it goes through, samples at least, its degree
_FINER = 4  # steps of an integral of the command in one of the grid


def resampled(recording: Recording, channel: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A channel at the instants of a grid, and where its readings are there (m)."""
    values = recording[channel]
    ok = np.isfinite(values)
    at, values, period = recording.time[ok], values[ok], recording.period
    behind = np.clip(np.searchsorted(at, time, side="right"), 1, len(at) - 1)
    dense = at[behind] - at[behind - 1] < _SPARSE * period
    met = np.minimum(np.abs(time - at[behind - 1]), np.abs(at[behind] - time)) < 1e-6
    known = (dense | met) & (time < at[-1] + period) & (time > at[0] - period)
    if channel == "motor_torque":  # a held torque jumps
        return np.interp(time, at, values), known
    return CubicSpline(*_bridged(at, values, period))(np.clip(time, at[0], at[-1])), known


def hub_resampled(model: Model, recording: Recording, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The hub angle at the instants of a grid, and where its readings are there (m).

    Where the command jumps the hub's acceleration does. What the command alone would make of the angle, without link
    and friction, is taken off before missing readings are bridged, and put back.
    """
    step = float(time[1] - time[0]) / _FINER
    fine = np.arange(recording.time[0] - step, recording.time[-1] + 2 * step, step)
    swing = model.drive(recording).impulse(fine) / model.rig["hub_inertia"]
    angle = np.r_[0.0, np.cumsum((swing[1:] + swing[:-1]) / 2 * step)]
    pushed = CubicHermiteSpline(fine, angle, swing)
    smooth = recording["hub_angle"] - pushed(recording.time)
    rest, known = resampled(
        recording.replace(channels={**recording.channels, "hub_angle": smooth}), "hub_angle", time
    )
    return rest + pushed(np.clip(time, recording.time[0], recording.time[-1])), known


def _bridged(time: np.ndarray, values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Known samples (n) with gaps filled by the polynomial through those on either side."""
    side = max(_FEWEST, round(_BESIDE / period))
    pieces_t, pieces_v = [time], [values]
    for g in np.flatnonzero(np.diff(time) > _GAP * period):
        beside = slice(max(0, g - side + 1), g + 1 + side)
        degree = min(_DEGREE, len(time[beside]) // 2)
        inside = np.arange(time[g] + period, time[g + 1] - period / 2, period)
        pieces_t.append(inside)
        pieces_v.append(Polynomial.fit(time[beside], values[beside], degree)(inside))
    order = np.argsort(np.concatenate(pieces_t), kind="stable")
    return np.concatenate(pieces_t)[order], np.concatenate(pieces_v)[order]
