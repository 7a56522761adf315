"""Measures of columns without a model: which is a time, which moves, leads, is smooth, repeats another, or rings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import lfilter, periodogram

from twin.campaigns import units
from twin.campaigns.readings import estimate_noise
from twin.files.time_column import LONGEST_PERIOD, SHORTEST_PERIOD
from twin.recording import ON_LINK

_GRID = 8192  # samples on which columns are compared
_ORDER = 8  # of the autoregressive model that whitens a column
_LAGS = 50  # samples over which one column is seen to lead another
_FEWEST = 200  # samples
_FEWEST_INSTANTS = 20
_SCATTER, _USUAL = 3.0, 0.9
"""Factor by which steps between instants differ from the median at most, and the share of them that do not by more."""
_TIMES = ("s", "ms", "us", "min")  # units of a time, in the order in which they are tried
_ROUNDED = 5.0  # roundings, of which the fourth difference of rounded numbers is made
_STILL = 6.0  # noise levels of range: what stays within them does not move
_AT_FIRST, _FEWEST_AT_FIRST = 0.05, 6
"""Time after the first sample [s] and samples in it from which its rate is told."""
_FAR = 0.25  # of its range from its middle, where a reading of a link begins that was bent
_CERTAIN = 5.0  # standard errors of a rate that is seen
_PROMINENT = 50.0  # times the median power of a spectrum has a resonance


def steadiness(values: np.ndarray) -> float:
    """Returns how well values (n) are instants: 0 where they do not increase strictly, 1 where they are uniform."""
    if len(values) < _FEWEST_INSTANTS or not np.isfinite(values).all():
        return 0.0
    steps = np.diff(values)
    if not (steps > 0).all():
        return 0.0
    relative = steps / float(np.median(steps))
    if np.mean((relative > 1 / _SCATTER) & (relative < _SCATTER)) < _USUAL:
        return 0.0
    return float(np.mean(np.abs(relative - 1) < 0.5))


def time_unit(values: np.ndarray) -> str:
    """Returns the unit in which instants (n) are those of a usual card, seconds if possible; "" if there is none."""
    step = float(np.median(np.diff(values)))
    periods = {unit: units.factor(unit, "s") * step for unit in _TIMES}
    return next((unit for unit, s in periods.items() if SHORTEST_PERIOD <= s <= LONGEST_PERIOD), "")


def on_grid(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns columns (n) interpolated to a uniform grid (m); those that do not vary are left out."""
    step = max(float(np.median(np.diff(time))), float(time[-1] - time[0]) / _GRID)
    instants = np.arange(time[0], time[-1], step)
    known = {name: np.isfinite(values) for name, values in columns.items()}
    return {
        name: np.interp(instants, time[known[name]], values[known[name]])
        for name, values in columns.items()
        if known[name].sum() > _FEWEST and np.nanstd(values) > 0
    }


def moves(values: np.ndarray) -> bool:
    """Whether a column (n) changes by more than its noise."""
    known = values[np.isfinite(values)]
    return (
        len(known) > 1 and float(np.ptp(known)) > _STILL * estimate_noise(known) + 1e-12 * np.abs(known).max()
    )


def computed(values: np.ndarray) -> bool:
    """Whether a column (m) has no noise but its rounding, as a command or reference that was computed."""
    scatter = float(np.median(np.abs(np.diff(values, 4))))
    rounding = np.diff(np.unique(values))
    return scatter <= max(
        1e-5 * float(np.ptp(values)), _ROUNDED * float(rounding.min() if len(rounding) else 0.0)
    )


def stepwise(values: np.ndarray) -> bool:
    """Whether a column (m) is piecewise constant with few changes."""
    changes = np.count_nonzero(np.diff(values))
    return bool(0 < changes < 0.05 * len(values) and computed(values))


def lead(cause: np.ndarray, others: Sequence[np.ndarray]) -> float:
    """Returns how far a column (m) leads others: 1 where they follow it and it never follows them, -1 reversed.

    By the cross-correlation after both are filtered so that the first is white: past values of a prescribed command
    show in a measurement, and none of a measurement in the command.
    """
    whitener = _whitener(cause)
    white = lfilter(whitener, [1.0], cause - cause[0])[_ORDER:]
    found = []
    for other in others:
        filtered = lfilter(whitener, [1.0], other - other[0])[_ORDER:]
        after, before = _correlations(white, filtered), _correlations(filtered, white)
        found.append((after - before) / (after + before) if after + before > 0 else 0.0)
    return float(np.mean(found)) if found else 0.0


def _whitener(values: np.ndarray) -> np.ndarray:
    """Coefficients (_ORDER + 1) of the filter that leaves the part of a column (m) that its own past does not tell."""
    centred = values - values.mean()
    lagged = np.column_stack([centred[_ORDER - k : len(centred) - k] for k in range(1, _ORDER + 1)])
    coefficients = np.linalg.lstsq(lagged, centred[_ORDER:], rcond=1e-10)[0]
    return np.concatenate([[1.0], -coefficients])


def _correlations(first: np.ndarray, second: np.ndarray) -> float:
    """Squared correlations of one column (m) with another one 1 to _LAGS samples later, summed."""
    a, b = first - first.mean(), second - second.mean()
    size = float(a @ a) * float(b @ b)
    if size == 0:
        return 0.0
    return sum(float(a[:-k] @ b[k:]) ** 2 for k in range(1, min(_LAGS, len(a) - 1))) / size


def alike(first: np.ndarray, second: np.ndarray) -> float:
    """Returns the magnitude of the correlation of two columns (m)."""
    a, b = first - first.mean(), second - second.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(a @ b)) / size if size > 0 else 0.0


def roughness(values: np.ndarray) -> float:
    """Returns the mean frequency of a column (m) in cycles per sample: small for the angle of a heavy hub."""
    frequency, power = periodogram(values - np.linspace(values[0], values[-1], len(values)))
    total = float(power.sum())
    return float(np.sqrt((frequency**2 * power).sum() / total)) if total > 0 else 0.0


def resonance(time: np.ndarray, values: np.ndarray, lowest: float = 0.2) -> float | None:
    """Returns the frequency of the largest peak of a link's reading (n) [Hz] above `lowest`; None if there is none."""
    grid = on_grid(time, {"": values}).get("")
    if grid is None:
        return None
    step = float(time[-1] - time[0]) / len(grid)
    # The change of a reading from sample to sample shows a vibration above slow bending.
    frequency, power = periodogram(np.diff(grid), 1 / step, window="hann")
    useful = (frequency > max(lowest, 3.0 / float(time[-1] - time[0]))) & (frequency < 0.25 / step)
    if not useful.any() or power[useful].max() < _PROMINENT * np.median(power[useful]):
        return None
    return float(frequency[useful][np.argmax(power[useful])])


def moving_first(time: np.ndarray, columns: Mapping[str, np.ndarray]) -> str:
    """Returns a channel that moves at the first sample of a recording; "" if none does.

    The hub's angle integrates its torque, so that its rate at that instant tells. A reading of the link follows a
    torque at once, and tells where the command does not change.

    Args:
      time: (n) instants [s].
      columns: channel -> (n) readings in any unit.
    """
    first = time - time[0] <= _AT_FIRST
    command = columns.get("torque_command", np.zeros(len(time)))[first]
    held = np.ptp(command[np.isfinite(command)]) == 0 if np.isfinite(command).any() else True
    channels = ("hub_angle", *(ON_LINK if held else ()))
    return next((c for c in channels if c in columns and not _at_rest_first(time, columns[c])), "")


def _at_rest_first(time: np.ndarray, values: np.ndarray) -> bool:
    """Whether a column (n) has no visible rate at its first sample, by a parabola through the first samples."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < _FEWEST_AT_FIRST:
        return True
    first = known[: max(_FEWEST_AT_FIRST, np.searchsorted(time[known] - time[0], _AT_FIRST, side="right"))]
    t, y = time[first] - time[0], values[first]
    basis = np.vander(t, 3)
    inverse = np.linalg.pinv(basis)
    coefficients = inverse @ y
    noise = max(estimate_noise(values), float(np.std(y - basis @ coefficients)))
    error = noise * float(np.linalg.norm(inverse[1]))
    return abs(coefficients[1]) <= max(_CERTAIN * error, 0.01 * float(np.ptp(values[np.isfinite(values)])))


def bent_first(values: np.ndarray) -> bool:
    """Whether a reading of the link (n) begins far from its middle, about which it swings."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and abs(known[0] - np.median(known)) > _FAR * float(np.ptp(known))


def signed(values: np.ndarray) -> bool:
    """Whether a column comes near 0, as a command does, and a supply voltage does not."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low <= 0.3 * abs(high) and high >= -0.3 * abs(low)
