"""Properties of readings without a model: noise, converter step, outliers, gaps and jumps, and the sampling clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import label, maximum_filter, median_filter

from twin.recording import Recording

_LONG_GAP = 0.1  # s, longest gap of the hub angle that may be interpolated
_BESIDE_GAP = 0.02  # s on either side of a gap or jump that are left out with it
_STRETCH = 50
"""Samples of a stretch: of white noise, the size of as many fourth differences is known to a sixth, of the median of 20
stretches to a twentieth. Of 20 to 200 samples it is the same, see tests/campaigns/test_noise_of_readings.py."""
_ROUNDING = 1e-9
"""Of the range of a signal: above that of doubles, below the step of a converter of 24 bits, 6e-8."""
_OUTLIER = 12.0  # noise standard deviations from the neighbours, beyond which a single sample is an outlier
_MOST_ADJACENT = 2
"""Outliers one behind the other: of three, the middle one has no neighbour that could tell.

On 26 campaigns, all 26 outliers are found with 1, 2 and no limit, and 38, 92 and 258 other readings beside them, nearly
all where an amplifier clips."""

_SINGLE = 1.8
"""Median steps, below which a step has no missing row in it: two, less what stamps jitter by."""
_FIRST_TICKS = 32
"""Samples of the first fit of a clock: over them the mean step, 0.5 % off where long steps count as missing rows, adds
up to a sixth of a tick. A fit to m stamps that scatter by s ticks is off by up to 7 s/sqrt(m) at 2 m: by 0.36 with
s = 0.29, that of rounding."""


def estimate_noise(values: np.ndarray) -> float:
    """Returns the standard deviation of the noise on a smooth signal (n), by the size of its fourth differences.

    The fourth difference of white noise has variance 70 sigma^2; that of a smooth signal is small. The median over
    stretches is taken: fast motion and outliers are in some. The result is at least the quantisation noise,
    step/sqrt(12); 0 where there are fewer than 20 values.
    """
    known = values[np.isfinite(values)]
    if len(known) < 20:
        return 0.0
    differences = np.diff(known, 4)
    stretches = np.array_split(differences, max(1, len(differences) // _STRETCH))
    sizes = [np.sqrt(np.mean(stretch**2) / 70.0) for stretch in stretches]
    return float(max(np.median(sizes), quantisation_step(known) / np.sqrt(12.0)))


def quantisation_step(values: np.ndarray) -> float:
    """Returns the quantisation step of readings (n); 0 where they take too many different values to show one.

    A signal that moves fast skips levels: it is the smallest distance of two, rounding apart.
    """
    levels = np.unique(values)
    if len(levels) > len(values) / 4 or len(levels) < 2:
        return 0.0
    distances = np.diff(levels)
    return float(distances[distances > _ROUNDING * np.ptp(levels)].min())


def without_outliers(recording: Recording, noise: dict[str, float]) -> tuple[Recording, list[str]]:
    """Returns the recording with single outliers replaced by NaN, and notes on them; `noise`: channel -> sigma, SI."""
    channels, notes = dict(recording.channels), []
    for name in recording.measured():
        values, sigma = channels[name], noise.get(name, 0.0)
        # A measured torque jumps with its command.
        if name == "motor_torque" or not sigma > 0 or np.isfinite(values).sum() < 20:
            continue
        far = _outliers(recording.time, values, sigma, _off_lines if name == "hub_rate" else _off_cubic)
        if far.any():
            channels[name] = np.where(far, np.nan, values)
            many = f"{far.sum()} outlier{'s' if far.sum() > 1 else ''}"
            notes.append(f"{recording.name}: {many} in {name} left out")
    return recording.replace(channels=channels), notes


def _outliers(
    time: np.ndarray,
    values: np.ndarray,
    sigma: float,
    off_neighbours: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> np.ndarray:
    """Mask (n) of single samples far from what their four neighbours predict; of a group, the farthest first.

    Where one sample after the other is far once the one beside it is left out, the signal itself moves fast.
    """
    outliers = np.zeros(len(values), dtype=bool)
    for _ in range(5):
        known = np.flatnonzero(np.isfinite(values) & ~outliers)
        distance = np.zeros(len(known))
        distance[2:-2] = off_neighbours(time[known], values[known])
        # During fast motion the prediction is inaccurate: an outlier also has to exceed the distances around it.
        level = np.maximum(_OUTLIER * sigma, 6 * median_filter(distance, 15, mode="nearest"))
        far = (distance > level) & (distance >= maximum_filter(distance, 5, mode="nearest"))
        if not far.any():
            break
        outliers[known[far]] = True
    runs, _ = label(outliers)
    return outliers & (np.bincount(runs)[runs] <= _MOST_ADJACENT)


def _off_cubic(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Distances (n - 4) of inner samples (n) from the cubic in time through their four neighbours."""
    at, beside = time[2:-2], (slice(None, -4), slice(1, -3), slice(3, -1), slice(4, None))
    predicted = np.zeros(len(at))
    for own in beside:
        weight = np.ones(len(at))
        for other in beside:
            if other is not own:
                weight *= (at - time[other]) / (time[own] - time[other])
        predicted += weight * values[own]
    return np.abs(values[2:-2] - predicted)


def _off_lines(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Distances (n - 4) of inner samples (n) from that cubic or the lines through the two neighbours on either side.

    The nearest counts: a rate has a kink where its command jumps or its hub sticks, and a sample there lies on a line.
    """
    slopes, at = np.diff(values) / np.diff(time), time[2:-2]
    before = values[1:-3] + slopes[:-3] * (at - time[1:-3])
    behind = values[3:-1] - slopes[3:] * (time[3:-1] - at)
    lines = np.abs(values[2:-2] - np.stack([before, behind])).min(axis=0)
    return np.minimum(_off_cubic(time, values), lines)


def longest_valid_stretch(
    recording: Recording, noise: float, strongest: float
) -> tuple[Recording, str | None]:
    """Returns the longest part of a recording without long gaps of the hub angle or jumps that no torque could cause.

    Args:
      recording: the recording; returned whole if its hub is clamped.
      noise: standard deviation of the hub angle [rad].
      strongest: largest possible acceleration of the hub [rad/s^2].

    Returns:
      The part, and a note on what was left out; None where nothing was.
    """
    if recording.clamped or "hub_angle" not in recording:
        return recording, None
    time, reading = recording.time, recording["hub_angle"]
    known = np.flatnonzero(np.isfinite(reading))
    steps, spans = np.diff(reading[known]), np.diff(time[known])
    # A jump is a rate between two readings that differs from the rates around it by more than any torque could cause.
    rates = steps / spans
    usual = median_filter(rates, 9, mode="nearest")
    jump = np.abs(rates - usual) * spans > 12 * noise + strongest / 2 * (spans + 0.02) ** 2
    breaks = np.flatnonzero(jump | (spans > max(_LONG_GAP, 2 * recording.period)))
    if not len(breaks):
        return recording, None
    edges = np.r_[-1, breaks, len(known) - 1]
    longest = int(
        np.argmax([time[known[b]] - time[known[a + 1]] for a, b in zip(edges[:-1], edges[1:], strict=True)])
    )
    first, last = known[edges[longest] + 1], known[edges[longest + 1]]
    # The wiper of a potentiometer gives arbitrary readings at the edge of its gap.
    long = time[last] - time[first] > 10 * _BESIDE_GAP
    if long and longest > 0:
        first = known[np.searchsorted(time[known], time[first] + _BESIDE_GAP)]
    if long and longest < len(edges) - 2:
        last = known[np.searchsorted(time[known], time[last] - _BESIDE_GAP, side="right") - 1]
    kept = slice(int(first), int(last) + 1)
    begins = "unknown" if first > 0 else recording.start
    cut = recording.part(kept).replace(start=begins)
    note = f"{recording.name}: the hub angle has long gaps or jumps; used from {time[first]:.2f} to {time[last]:.2f} s"
    return cut, note


def sample_clock(time: np.ndarray) -> np.ndarray | None:
    """Returns the ticks (n) of the uniform clock about which time stamps (n) jitter [s]; None where they do not.

    A card may output its commands on a uniform clock although the time stamps of its readings jitter. Samples may be
    missing. The jitter has to have a standard deviation of 0.001 to 0.3 sample periods.
    """
    steps, since = np.diff(time), time - time[0]
    # What a first period is off by would add up to whole ticks over a recording: so it is refined on longer parts.
    period, first, count = float(np.mean(steps[steps < _SINGLE * np.median(steps)])), 0.0, _FIRST_TICKS
    ticks = np.zeros(0)
    while len(ticks) < len(since):
        ticks = np.round((since[:count] - first) / period)
        period, first = np.polyfit(ticks, since[:count], 1)
        count *= 2
    ticks = np.round((since - first) / period)
    scatter = since - first - period * ticks
    if len(np.unique(ticks)) < len(ticks) or not 1e-3 < np.std(scatter) / period < 0.3:
        return None
    return time[0] + first + period * ticks
