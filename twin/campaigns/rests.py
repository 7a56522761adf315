"""What a recording says by itself, before any model: its noise, its outliers, when the hub rests and moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation, binary_erosion, label
from scipy.signal import savgol_filter

from twin.mechanics.planar import STUCK, UNDECIDED
from twin.mechanics.state import Guide, Start
from twin.recording import Recording

_REST_SPAN = 0.08  # s, shortest rest that counts
_EDGE = 0.02  # s, margin to a change between rest and motion
_SURE = 6.0  # standard errors of the rate beyond which the hub surely moves
ONSET_LEVEL, ONSET_SAMPLES = 4.0, 4
"""Noise levels, and readings in a row beyond them, by which the hub has left its rest."""
SAMPLES_BEFORE_ONSET = 2
"""Samples from the last instant at rest to the first visible motion."""
_RATE_SPAN = 0.024  # s, over which the rate is estimated


@dataclass(frozen=True)
class HubMotion:
    """Rests and motion of the hub, seen in its own measurement.

    Attributes:
      observed: (n) int64, `STUCK`, +1, -1 or `UNSURE`.
      tight: (n) the same, sure up to two samples before a rest visibly ends.
      reading: (n) mean reading while it rests, elsewhere the reading [rad].
      onsets: (sample, direction) at which the reading first leaves a rest for good.
    """

    observed: np.ndarray
    tight: np.ndarray
    reading: np.ndarray
    onsets: tuple[tuple[int, int], ...]


def classify_hub_motion(recording: Recording, noise: float) -> HubMotion:
    """Classifies each sample: rest, motion to either side, or no clear word.

    A rest is a stretch over which the smoothed reading stays within the noise; a motion is a local slope
    beyond six standard errors.
    """
    time = recording.time
    reading = np.array(recording["hub_angle"])
    known = np.isfinite(reading)
    filled = np.interp(time, time[known], reading[known])
    dt = float(np.median(np.diff(time)))
    window = _window(_RATE_SPAN / dt, 7, len(time))
    rate = savgol_filter(filled, window, 1, deriv=1, delta=dt)
    error = noise / dt / np.sqrt(window * (window**2 - 1) / 12)
    observed = np.full(len(time), UNDECIDED, dtype=np.int64)
    observed[np.abs(rate) > _SURE * error] = 0
    moving = np.abs(rate) > _SURE * error
    observed[moving] = np.sign(rate[moving]).astype(np.int64)
    resting = _resting(filled, noise, dt)
    observed[resting] = STUCK
    observed[~resting & (observed == STUCK)] = UNDECIDED
    loose, rest = _with_margins(observed, dt), _rest_reading(filled, resting)
    onsets = _onsets(loose, rest, reading, noise)
    return HubMotion(loose, _tightened(loose, onsets), rest, onsets)


def simulation_guide(motion: HubMotion, angle: np.ndarray, tight: bool) -> Guide:
    """The guide of a simulation: `angle` (n) is the hub angle [rad] that the sensor reports as `motion.reading`."""
    return Guide(motion.tight if tight else motion.observed, np.ascontiguousarray(angle))


def first_reading(recording: Recording, motion: HubMotion | None) -> float:
    """Hub reading at the first sample [rad]: the mean of the rest with which the recording starts."""
    if "hub_angle" not in recording:
        return 0.0
    reading = recording["hub_angle"]
    if motion is not None and motion.observed[0] == STUCK:
        return float(motion.reading[0])
    known = reading[np.isfinite(reading)]
    return float(known[:5].mean()) if len(known) else 0.0


def estimate_moving_start(recording: Recording) -> Start:
    """First guess of the state of a rig that was already moving: slope and level of the first readings."""
    if "hub_angle" not in recording:
        return Start()
    first = recording.time < recording.time[0] + 0.04
    known = first & np.isfinite(recording["hub_angle"])
    if known.sum() < 3:
        return Start(hub_angle=first_reading(recording, None))
    slope, level = np.polyfit(recording.time[known] - recording.time[0], recording["hub_angle"][known], 1)
    return Start(hub_angle=float(level), hub_rate=float(slope))


def _window(count: float, least: int, most: int) -> int:
    """An odd number of samples about `count`, no less than `least`, unless there are fewer."""
    return min(max(least, 2 * int(count / 2) + 1), most - 1 + most % 2)


def _resting(filled: np.ndarray, noise: float, dt: float) -> np.ndarray:
    """Samples within stretches over which the reading is constant to within its noise."""
    window = _window(_REST_SPAN / dt, 9, len(filled))
    slope = savgol_filter(filled, window, 1, deriv=1, delta=dt)
    error = noise / dt / np.sqrt(window * (window**2 - 1) / 12)
    mean = savgol_filter(filled, window, 0)
    spread = np.sqrt(np.maximum(savgol_filter(filled**2, window, 0) - mean**2, 0))
    still = (np.abs(slope) < 3.5 * error) & (spread < 1.6 * noise)
    # `still` marks the middles of quiet windows: a rest reaches half a window beyond them.
    still = binary_erosion(still, iterations=2, border_value=1)
    return binary_dilation(still, iterations=window // 2 - 2)


def _with_margins(observed: np.ndarray, dt: float) -> np.ndarray:
    """Takes the certainty away next to every change between rest and motion."""
    margin = max(1, int(round(_EDGE / dt)))
    sure = observed.copy()
    for flag in (STUCK, 1, -1):
        inside = observed == flag
        core = binary_erosion(inside, iterations=margin, border_value=1)
        sure[inside & ~core] = UNDECIDED
    return sure


def _onsets(
    observed: np.ndarray, rest: np.ndarray, reading: np.ndarray, noise: float
) -> tuple[tuple[int, int], ...]:
    ends = np.flatnonzero((observed[:-1] == STUCK) & (observed[1:] != STUCK))
    starts = np.flatnonzero((observed[:-1] != STUCK) & (observed[1:] == STUCK)) + 1
    found = []
    for end in ends:
        until = starts[starts > end]
        stop = int(until[0]) if len(until) else len(observed)
        away = np.nan_to_num((reading[end:stop] - rest[end]) / noise, nan=0.0)
        out = np.abs(away) > ONSET_LEVEL
        if len(out) < ONSET_SAMPLES:
            continue
        lasting = sliding_window_view(out, ONSET_SAMPLES).all(axis=1)
        if lasting.any():
            first = int(np.argmax(lasting))
            found.append((int(end) + first, 1 if away[first] > 0 else -1))
    return tuple(found)


def _tightened(observed: np.ndarray, onsets: tuple[tuple[int, int], ...]) -> np.ndarray:
    tight = observed.copy()
    for onset, direction in onsets:
        last = np.flatnonzero(observed[: onset + 1] == STUCK)[-1]
        tight[last : max(last, onset - SAMPLES_BEFORE_ONSET) + 1] = STUCK
        tight[max(last + 1, onset - SAMPLES_BEFORE_ONSET + 1) : onset + 1] = direction
        # From here to where the motion is sure in itself.
        ahead = onset + 1
        while ahead < len(observed) and observed[ahead] == UNDECIDED and ahead < onset + SAMPLES_BEFORE_ONSET:
            tight[ahead] = direction
            ahead += 1
    return tight


def _rest_reading(filled: np.ndarray, resting: np.ndarray) -> np.ndarray:
    reading = filled.copy()
    stretches, count = label(resting)
    for index in range(1, count + 1):
        inside = stretches == index
        reading[inside] = filled[inside].mean()
    return reading
