"""Backbone curve of the first resonance: its frequency in sweeps of different amplitude, f = f0 (1 + s (a/a_max)^2).

Hub friction and large bending shift the resonance as well, so the slope s alone is no evidence of a softening link.
The same sweeps are therefore simulated with the identified model; the slope of the ratio measured/simulated is what
the model lacks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from twin.identification import spectra
from twin.identification.estimates import Estimate, student_t_estimate
from twin.identification.spectra import Response
from twin.recording import Recording

MIN_SWEEPS = 3
"""Sweeps needed for a line with two parameters and one degree of freedom."""
_MIN_BANDWIDTH = 2.0  # Hz that a sweep has to excite
_MIN_PROMINENCE = 2.0  # height of a peak over the median response about it [1]
_SEARCH_BAND = 0.35  # relative distance from the expected frequency within which a peak is the same mode [1]


@dataclass(frozen=True)
class Backbone:
    """Frequency of a resonance in n sweeps.

    Attributes:
      recordings: names (n), in the order of amplitude.
      channel: of the amplitude.
      amplitude: (n) largest vibration near the resonance, units of the channel.
      frequency: (n) of the peak [Hz].
      small_amplitude: f0, extrapolated to amplitude 0 [Hz].
      slope: s, relative change of the frequency at the largest amplitude [1].
      simulated_slope: s of the model in the same sweeps [1]; None where it was not simulated or shows no resonance.
      residual_slope: s of the ratio measured/simulated [1]; negative where the link softens more than the model.
    """

    recordings: tuple[str, ...]
    channel: str
    amplitude: np.ndarray
    frequency: tuple[Estimate, ...]
    small_amplitude: Estimate
    slope: Estimate
    simulated_slope: float | None = None
    residual_slope: Estimate | None = None

    @property
    def depends_on_amplitude(self) -> bool:
        """Whether the 95 % interval of the slope excludes zero."""
        return _differs_from_zero(self.slope)

    @property
    def differs_from_model(self) -> bool | None:
        """Whether the 95 % interval of the residual slope excludes zero; None without a simulation."""
        return None if self.residual_slope is None else _differs_from_zero(self.residual_slope)


def _differs_from_zero(slope: Estimate) -> bool:
    low, high = slope.interval
    return not low <= 0 <= high


def backbone(recordings: Sequence[Recording], expected: float) -> Backbone | None:
    """Returns the backbone of the mode near `expected` [Hz]; None if fewer than `MIN_SWEEPS` recordings show it."""
    rows = []
    for recording in recordings:
        response = spectra.frequency_response([recording], least=_MIN_BANDWIDTH)
        peak = resonance(response, expected) if response else None
        if response and peak:
            size = _largest_amplitude(recording, response.channel, peak.value)
            rows.append((size, peak, recording.name, response.channel))
    channels = {channel for *_, channel in rows}
    if len(rows) < MIN_SWEEPS or len(channels) > 1:
        return None
    rows.sort(key=lambda row: row[0])
    amplitude = np.array([row[0] for row in rows])
    frequency = tuple(row[1] for row in rows)
    small, slope = _fit_line((amplitude / amplitude[-1]) ** 2, frequency)
    return Backbone(tuple(row[2] for row in rows), channels.pop(), amplitude, frequency, small, slope)


def with_simulation(
    curve: Backbone, pairs: Sequence[tuple[Recording, Recording]], expected: float
) -> Backbone:
    """Returns the backbone with the slope of the simulated sweeps and of the ratio measured/simulated.

    The width of a peak is common to both and cancels in the ratio: its error is that of the frequency grid, or the
    scatter about the line where that is larger.

    Args:
      curve: the measured backbone.
      pairs: each sweep as measured and as simulated.
      expected: frequency about which peaks are searched [Hz].
    """
    rows = []
    for measured, moved in pairs:
        # A simulation has no reference, which the response of a closed loop needs.
        simulated = moved.replace(channels={**measured.channels, **moved.channels})
        peaks = [_peak_of_recording(r, curve.channel, expected) for r in (measured, simulated)]
        if measured.name in curve.recordings and peaks[0] and peaks[1]:
            size = curve.amplitude[curve.recordings.index(measured.name)]
            rows.append((float(size), peaks[0], peaks[1]))
    if len(rows) < MIN_SWEEPS:
        return curve
    share = np.array([(size / curve.amplitude[-1]) ** 2 for size, *_ in rows])
    ratios = [
        Estimate(a.value / b.value, math.hypot(a.standard_error, b.standard_error) / b.value)
        for _, a, b in rows
    ]
    _, simulated_slope = _fit_line(share, [b for *_, b in rows])
    _, residual_slope = _fit_line(share, ratios)
    return replace(curve, simulated_slope=simulated_slope.value, residual_slope=residual_slope)


def _peak_of_recording(recording: Recording, channel: str, expected: float) -> Estimate | None:
    """Frequency of the largest response near `expected` [Hz], as uncertain as the grid; None at an edge of the band."""
    response = (
        spectra.frequency_response([recording], channel, _MIN_BANDWIDTH)
        if np.isfinite(recording[channel]).any()
        else None
    )
    if response is None:
        return None
    near = response.known & (np.abs(response.frequency / expected - 1) < _SEARCH_BAND)
    f, size = response.frequency[near], np.abs(response.h1[near])
    top = int(np.argmax(size)) if len(f) else 0
    if top in (0, len(f) - 1):
        return None
    return Estimate(float(f[top]), float(response.frequency[1] - response.frequency[0]) / math.sqrt(12))


def resonance(response: Response, expected: float) -> Estimate | None:
    """Returns the resonance near `expected` [Hz]: a fitted peak, else the maximum of the response.

    A softening resonance has no peak that a linear mode fits.
    """
    fitted = [p for p in spectra.peaks(response) if abs(p.frequency.value / expected - 1) < _SEARCH_BAND]
    if fitted:
        return max(fitted, key=lambda p: p.height).frequency
    near = response.known & (np.abs(response.frequency / expected - 1) < _SEARCH_BAND)
    f, size = response.frequency[near], np.abs(response.h1[near])
    if len(f) < 12:
        return None
    top = int(np.argmax(size))
    if top in (0, len(f) - 1) or size[top] < _MIN_PROMINENCE * np.median(size):
        return None
    # Uniformly distributed over the band in which the response exceeds 90 % of the peak.
    width = float((size > 0.9 * size[top]).sum() * (f[1] - f[0]))
    return Estimate(float(f[top]), max(width, response.resolution) / math.sqrt(12))


def _largest_amplitude(recording: Recording, channel: str, frequency: float) -> float:
    """Largest amplitude of a channel between 0.8 and 1.25 times a frequency [Hz], by a zero-phase band-pass."""
    known = np.isfinite(recording[channel])
    period = recording.period
    time = np.arange(recording.time[0], recording.time[-1], period)
    values = np.interp(time, recording.time[known], recording[channel][known])
    band = [0.8 * frequency, 1.25 * frequency]
    return float(np.abs(sosfiltfilt(butter(2, band, "band", fs=1 / period, output="sos"), values)).max())


def _fit_line(share: np.ndarray, frequency: Sequence[Estimate]) -> tuple[Estimate, Estimate]:
    """f0 and s of f = f0 (1 + s share) by weighted least squares.

    Errors grow by the root of the reduced chi-squared where that exceeds 1; intervals are then Student's.

    Args:
      share: (n) squared amplitude over its largest value [1].
      frequency: (n) frequencies or ratios of frequencies.
    """
    f = np.array([e.value for e in frequency])
    w = 1 / np.array([e.standard_error for e in frequency])
    X = np.column_stack([np.ones(len(f)), share]) * w[:, None]
    x, *_ = np.linalg.lstsq(X, f * w, rcond=None)
    r = X @ x - f * w
    free = max(len(f) - 2, 1)
    excess = max(1.0, float(r @ r) / free)
    covariance = np.linalg.inv(X.T @ X) * excess

    def estimate(value: float, error: float) -> Estimate:
        return student_t_estimate(value, error, free) if excess > 1 else Estimate(value, error)

    small = estimate(float(x[0]), float(np.sqrt(covariance[0, 0])))
    # Gradient of s = x1/x0.
    row = np.array([-x[1] / x[0] ** 2, 1 / x[0]])
    return small, estimate(float(x[1] / x[0]), float(np.sqrt(row @ covariance @ row)))
