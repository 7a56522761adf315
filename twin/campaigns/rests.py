"""Rests and motion of the hub, classified from its measured angle without a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation, binary_erosion, find_objects, label
from scipy.signal import savgol_filter

from twin.mechanics.planar import STUCK, UNDECIDED
from twin.mechanics.state import Guide, Start
from twin.recording import Recording, sample_period

_REST_SPAN = 0.08  # s, window of the test for rest, so the shortest rest that is recognised
_EDGE = 0.02  # s before and after a change between rest and motion that are undecided
_CERTAIN = 6.0  # standard errors of the rate, from which the hub moves
_STEADY = 3.5
"""Standard errors up to which the slope of a window is none, and the spread of the means of a rest's windows, too:
noise that is the same over 12 = 3.5^2 samples spreads these as far."""
ONSET_LEVEL, ONSET_SAMPLES = 4.0, 4
"""Distance from the rest reading in standard deviations, and consecutive readings beyond it, that show an onset."""
SAMPLES_BEFORE_ONSET = 2
"""Samples between the last one that is still at rest and the first visible motion."""
_RATE_SPAN = 0.024  # s, window of the rate estimate


@dataclass(frozen=True)
class HubMotion:
    """Rests and motion of the hub in its measured angle.

    Attributes:
      observed: (n) int64, `STUCK`, +1 or -1 (direction of motion), or `UNDECIDED`, as near every change.
      tight: (n) the same, with rests extended to `SAMPLES_BEFORE_ONSET` samples before their visible end.
      reading: (n) mean reading of each rest, the reading itself elsewhere [rad].
      onsets: (sample, direction) where the reading departs from each rest.
    """

    observed: np.ndarray
    tight: np.ndarray
    reading: np.ndarray
    onsets: tuple[tuple[int, int], ...]


def classify_hub_motion(recording: Recording, noise: float) -> HubMotion:
    """Classifies each sample of a recording as rest, motion in one direction, or undecided.

    The hub rests where the local slope is insignificant and the scatter within the noise; it moves where the local
    slope exceeds six standard errors.

    Args:
      recording: with a hub angle.
      noise: its standard deviation [rad].
    """
    time = recording.time
    reading = np.array(recording["hub_angle"])
    known = np.isfinite(reading)
    filled = np.interp(time, time[known], reading[known])
    dt = sample_period(time)
    window = _window(_RATE_SPAN / dt, 7, len(time))
    rate = savgol_filter(filled, window, 1, deriv=1, delta=dt)
    error = noise / dt / np.sqrt(window * (window**2 - 1) / 12)
    observed = np.full(len(time), UNDECIDED, dtype=np.int64)
    moving = np.abs(rate) > _CERTAIN * error
    observed[moving] = np.sign(rate[moving]).astype(np.int64)
    resting = _resting(filled, noise, dt)
    observed[resting] = STUCK
    observed[~resting & (observed == STUCK)] = UNDECIDED
    loose, rest = _with_margins(observed, dt), _rest_reading(filled, resting)
    onsets = _onsets(loose, rest, reading, noise)
    return HubMotion(loose, _tightened(loose, onsets), rest, onsets)


def simulation_guide(motion: HubMotion, angle: np.ndarray, tight: bool) -> Guide:
    """Returns the guide of a simulation.

    Args:
      motion: classified samples.
      angle: (n) hub angle for which the sensor reports `motion.reading` [rad].
      tight: use `motion.tight` instead of `motion.observed`.
    """
    return Guide(motion.tight if tight else motion.observed, np.ascontiguousarray(angle))


def first_reading(recording: Recording, motion: HubMotion | None) -> float:
    """Returns the hub reading at the first sample [rad]: the mean of the initial rest, else of up to five readings."""
    if "hub_angle" not in recording:
        return 0.0
    reading = recording["hub_angle"]
    if motion is not None and motion.observed[0] == STUCK:
        return float(motion.reading[0])
    known = reading[np.isfinite(reading)]
    return float(known[:5].mean()) if len(known) else 0.0


def estimate_moving_start(recording: Recording) -> Start:
    """Returns an initial guess of the state of a moving rig: a line through the hub readings of the first 0.04 s."""
    if "hub_angle" not in recording:
        return Start()
    first = recording.time < recording.time[0] + 0.04
    known = first & np.isfinite(recording["hub_angle"])
    if known.sum() < 3:
        return Start(hub_angle=first_reading(recording, None))
    slope, level = np.polyfit(recording.time[known] - recording.time[0], recording["hub_angle"][known], 1)
    return Start(hub_angle=float(level), hub_rate=float(slope))


def _window(count: float, least: int, most: int) -> int:
    """Returns an odd number of samples near `count`, at least `least` and at most `most`."""
    return min(max(least, 2 * int(count / 2) + 1), most - 1 + most % 2)


def _resting(filled: np.ndarray, noise: float, dt: float) -> np.ndarray:
    """Mask (n) of samples in windows over which the reading is constant within its noise [rad]."""
    window = _window(_REST_SPAN / dt, 9, len(filled))
    slope = savgol_filter(filled, window, 1, deriv=1, delta=dt)
    error = noise / dt / np.sqrt(window * (window**2 - 1) / 12)
    mean = savgol_filter(filled, window, 0)
    spread = np.sqrt(np.maximum(savgol_filter(filled**2, window, 0) - mean**2, 0))
    still = (np.abs(slope) < _STEADY * error) & (spread < 1.6 * noise)
    # `still` marks the centres of windows at rest: rests extend half a window beyond.
    still = binary_erosion(still, iterations=2, border_value=1)
    resting = binary_dilation(still, iterations=window // 2 - 2)
    return resting & ~_drifting(resting, filled, window, noise)


def _drifting(resting: np.ndarray, filled: np.ndarray, window: int, noise: float) -> np.ndarray:
    """Stretches of a mask (n) whose windows differ in their means: each seems at rest, and the hub moves slowly.

    So does a hub that the link presses on a flank of a backlash, while friction holds the motor.
    """
    drifting = np.zeros(len(resting), dtype=bool)
    for (inside,) in find_objects(label(resting)[0]):
        reading = filled[inside]
        means = [part.mean() for part in np.array_split(reading, max(len(reading) // window, 1))]
        drifting[inside] = np.std(means) > _STEADY * noise / np.sqrt(window)
    return drifting


def _with_margins(observed: np.ndarray, dt: float) -> np.ndarray:
    """Returns the flags (n) with samples within `_EDGE` of a change undecided."""
    margin = max(1, int(round(_EDGE / dt)))
    eroded = observed.copy()
    for flag in (STUCK, 1, -1):
        inside = observed == flag
        core = binary_erosion(inside, iterations=margin, border_value=1)
        eroded[inside & ~core] = UNDECIDED
    return eroded


def _onsets(
    observed: np.ndarray, rest: np.ndarray, reading: np.ndarray, noise: float
) -> tuple[tuple[int, int], ...]:
    """Sample and direction at which the reading departs from each rest by `ONSET_LEVEL` for `ONSET_SAMPLES` samples."""
    ends = np.flatnonzero((observed[:-1] == STUCK) & (observed[1:] != STUCK))
    starts = np.flatnonzero((observed[:-1] != STUCK) & (observed[1:] == STUCK)) + 1
    onsets = []
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
            onsets.append((int(end) + first, 1 if away[first] > 0 else -1))
    return tuple(onsets)


def _tightened(observed: np.ndarray, onsets: tuple[tuple[int, int], ...]) -> np.ndarray:
    """Returns the flags (n) with rests extended to shortly before each onset, and motion from there on."""
    tight = observed.copy()
    for onset, direction in onsets:
        last = np.flatnonzero(observed[: onset + 1] == STUCK)[-1]
        tight[last : max(last, onset - SAMPLES_BEFORE_ONSET) + 1] = STUCK
        tight[max(last + 1, onset - SAMPLES_BEFORE_ONSET + 1) : onset + 1] = direction
        # Continue to where motion is certain from the slope, but not far.
        ahead = onset + 1
        while ahead < len(observed) and observed[ahead] == UNDECIDED and ahead < onset + SAMPLES_BEFORE_ONSET:
            tight[ahead] = direction
            ahead += 1
    return tight


def _rest_reading(filled: np.ndarray, resting: np.ndarray) -> np.ndarray:
    """Returns the readings (n) with each rest replaced by its mean [rad]."""
    reading = filled.copy()
    for (inside,) in find_objects(label(resting)[0]):
        reading[inside] = filled[inside].mean()
    return reading
