"""Single readings of a recording: their noise, outliers, sound stretches, and the clock they were taken on."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, median_filter

from twin.recording import Recording

_LONG_GAP = 0.1  # s without a reading of the hub beyond which its motion is not known
_BESIDE_GAP = 0.02  # s beside a gap or jump that are left out with it
_OUTLIER = 12.0  # noise standard deviations beyond which a lone sample is no measurement


def estimate_noise(values: np.ndarray) -> float:
    """Standard deviation of the noise on a smooth signal (n), from its fourth differences.

    The fourth difference of white noise has variance 70 sigma^2; a smooth signal hardly adds to it.
    """
    known = values[np.isfinite(values)]
    if len(known) < 20:
        return 0.0
    differences = np.diff(known, 4)
    scatter = 1.4826 * np.median(np.abs(differences - np.median(differences))) / np.sqrt(70.0)
    return float(max(scatter, quantisation_step(known) / np.sqrt(12.0)))


def quantisation_step(values: np.ndarray) -> float:
    """Step of the converter that the readings (n) came through; 0 where they are not visibly quantised."""
    levels = np.unique(values)
    if len(levels) > len(values) / 4 or len(levels) < 2:
        return 0.0
    return float(np.median(np.diff(levels)))


def without_outliers(recording: Recording, noise: dict[str, float]) -> tuple[Recording, list[str]]:
    """Returns the recording with lone outliers as missing samples, and what was left out."""
    channels, notes = dict(recording.channels), []
    for name in recording.measured():
        values, sigma = channels[name], noise.get(name, 0.0)
        # A measured torque jumps with its command: a jump is no outlier.
        if name == "motor_torque" or not sigma > 0 or np.isfinite(values).sum() < 20:
            continue
        far = _outliers(values, sigma)
        if far.any():
            channels[name] = np.where(far, np.nan, values)
            many = f"{far.sum()} outlier{'s' if far.sum() > 1 else ''}"
            notes.append(f"{recording.name}: {many} in {name} left out")
    return recording.replace(channels=channels), notes


def _outliers(values: np.ndarray, sigma: float) -> np.ndarray:
    """Lone samples (n) far from the cubic through their four neighbours, the farthest of a group first."""
    index = np.arange(len(values))
    found = np.zeros(len(values), dtype=bool)
    for _ in range(5):
        known = np.isfinite(values) & ~found
        x = np.interp(index, index[known], values[known])
        off = np.zeros(len(x))
        off[2:-2] = np.abs(x[2:-2] - (4 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:]) / 6)
        # In a fast stretch the cubic itself is off: an outlier stands out from its surroundings too.
        level = np.maximum(_OUTLIER * sigma, 6 * median_filter(off, 15, mode="nearest"))
        far = known & (off > level) & (off >= maximum_filter(off, 5, mode="nearest"))
        if not far.any():
            break
        found |= far
    return found


def longest_valid_stretch(
    recording: Recording, noise: float, strongest: float
) -> tuple[Recording, str | None]:
    """Cuts a recording at long gaps of the hub angle and at motion that no torque could make.

    Args:
      recording: with a free hub.
      noise: standard deviation of the hub angle [rad].
      strongest: acceleration beyond which a reading is no motion [rad/s^2].

    Returns:
      The longest stretch without either, and what was left out, or None where nothing was.
    """
    if recording.clamped or "hub_angle" not in recording:
        return recording, None
    time, reading = recording.time, recording["hub_angle"]
    known = np.flatnonzero(np.isfinite(reading))
    steps, spans = np.diff(reading[known]), np.diff(time[known])
    # Over a short gap a jump shows as a rate that differs from those around it by more than a torque can make.
    rates = steps / spans
    usual = median_filter(rates, 9, mode="nearest")
    jump = np.abs(rates - usual) * spans > 12 * noise + strongest / 2 * (spans + 0.02) ** 2
    breaks = np.flatnonzero(jump | (spans > _LONG_GAP))
    if not len(breaks):
        return recording, None
    edges = np.r_[-1, breaks, len(known) - 1]
    longest = int(
        np.argmax([time[known[b]] - time[known[a + 1]] for a, b in zip(edges[:-1], edges[1:], strict=True)])
    )
    first, last = known[edges[longest] + 1], known[edges[longest + 1]]
    # A wiper at the edge of its gap reads anything.
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
    """Instants (n) of the uniform clock about which jittered time stamps scatter; None where they do not.

    A card's output may keep to its clock while the instants of its readings scatter. Samples may be missing.
    """
    period = float(np.median(np.diff(time)))
    ticks = np.round((time - time[0]) / period)
    for _ in range(3):
        period, first = np.polyfit(ticks, time, 1)
        ticks = np.round((time - first) / period)
    scatter = time - first - period * ticks
    if len(np.unique(ticks)) < len(ticks) or not 1e-3 < np.std(scatter) / period < 0.3:
        return None
    return first + period * ticks
