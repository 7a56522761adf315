"""How a resonance moves with its amplitude: its frequency in sweeps of different size, f = f0 (1 + s a^2).

Friction of the hub and large bends move it too, so that a slope is no softening by itself: the same sweeps are
simulated, and what the measured frequency over the simulated one moves by is what the model lacks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from twin.identification import spectra
from twin.identification.estimates import Estimate
from twin.identification.spectra import Response
from twin.recording import Recording

LEAST_SWEEPS = 3
_BAND = 2.0  # Hz that a sweep has to cover at least
_STANDS_OUT = 2.0  # height of a peak over the response about it from which it counts
_REACH = 0.35  # relative distance from the expected frequency up to which a peak is the same mode


@dataclass(frozen=True)
class Backbone:
    """A resonance in several sweeps.

    Attributes:
      recordings: names (n), by amplitude.
      channel: in whose units the amplitude is.
      amplitude: (n) largest vibration near the resonance.
      frequency: (n) of the peak [Hz].
      small: frequency of small vibration [Hz].
      slope: relative change of the frequency at the largest amplitude [1].
      simulated: that of the model in the same sweeps [1]; None where it was not simulated or shows no resonance.
      beyond: of the measured frequency over the simulated one [1]; negative where the link softens.
    """

    recordings: tuple[str, ...]
    channel: str
    amplitude: np.ndarray
    frequency: tuple[Estimate, ...]
    small: Estimate
    slope: Estimate
    simulated: float | None = None
    beyond: Estimate | None = None

    @property
    def moves(self) -> bool:
        """Whether the frequency depends on the amplitude beyond its 95 % interval."""
        return _not_zero(self.slope)

    @property
    def softens(self) -> bool | None:
        """Whether it does so in another way than the model's; None where that was not simulated."""
        return None if self.beyond is None else _not_zero(self.beyond)


def _not_zero(slope: Estimate) -> bool:
    low, high = slope.interval
    return not low <= 0 <= high


def backbone(recordings: Sequence[Recording], expected: float) -> Backbone | None:
    """The backbone of the mode near a frequency [Hz]; None without `LEAST_SWEEPS` recordings that show it."""
    rows = []
    for recording in recordings:
        found = spectra.response([recording], least=_BAND)
        top = resonance(found, expected) if found else None
        if found and top:
            size = _amplitude(recording, found.channel, top.value)
            rows.append((size, top, recording.name, found.channel))
    channels = {channel for *_, channel in rows}
    if len(rows) < LEAST_SWEEPS or len(channels) > 1:
        return None
    rows.sort(key=lambda row: row[0])
    amplitude = np.array([row[0] for row in rows])
    frequency = tuple(row[1] for row in rows)
    small, slope = _line((amplitude / amplitude[-1]) ** 2, frequency)
    return Backbone(tuple(row[2] for row in rows), channels.pop(), amplitude, frequency, small, slope)


def beside(found: Backbone, pairs: Sequence[tuple[Recording, Recording]], expected: float) -> Backbone:
    """The backbone with what a model says of it.

    What makes a top broad is the same in both: their ratio is as uncertain as the grid of frequencies, or its scatter.

    Args:
      found: the backbone.
      pairs: sweeps as measured and as simulated.
      expected: frequency about which both are looked for [Hz].
    """
    rows = []
    for measured, simulated in pairs:
        here, there = (_top(r, found.channel, expected) for r in (measured, simulated))
        if measured.name in found.recordings and here and there:
            size = found.amplitude[found.recordings.index(measured.name)]
            rows.append((float(size), here, there))
    if len(rows) < LEAST_SWEEPS:
        return found
    share = np.array([(size / found.amplitude[-1]) ** 2 for size, *_ in rows])
    ratios = [
        Estimate(a.value / b.value, math.hypot(a.standard_error, b.standard_error) / b.value)
        for _, a, b in rows
    ]
    _, alone = _line(share, [b for *_, b in rows])
    _, beyond = _line(share, ratios)
    return replace(found, simulated=alone.value, beyond=beyond)


def _top(recording: Recording, channel: str, expected: float) -> Estimate | None:
    """Where a response is largest near a frequency [Hz], as uncertain as its grid; None at an edge."""
    found = spectra.response([recording], channel, _BAND) if np.isfinite(recording[channel]).any() else None
    if found is None:
        return None
    near = found.known & (np.abs(found.frequency / expected - 1) < _REACH)
    f, size = found.frequency[near], np.abs(found.h1[near])
    top = int(np.argmax(size)) if len(f) else 0
    if top in (0, len(f) - 1):
        return None
    return Estimate(float(f[top]), float(found.frequency[1] - found.frequency[0]) / math.sqrt(12))


def resonance(found: Response, expected: float) -> Estimate | None:
    """The resonance near a frequency [Hz]: a fitted peak, or the top of one that is no mode's, as a softening's is."""
    fitted = [p for p in spectra.peaks(found) if abs(p.frequency.value / expected - 1) < _REACH]
    if fitted:
        return max(fitted, key=lambda p: p.height).frequency
    near = found.known & (np.abs(found.frequency / expected - 1) < _REACH)
    f, size = found.frequency[near], np.abs(found.h1[near])
    if len(f) < 12:
        return None
    top = int(np.argmax(size))
    if top in (0, len(f) - 1) or size[top] < _STANDS_OUT * np.median(size):
        return None
    # Anywhere in the upper tenth of the peak.
    width = float((size > 0.9 * size[top]).sum() * (f[1] - f[0]))
    return Estimate(float(f[top]), max(width, found.resolution) / math.sqrt(12))


def _amplitude(recording: Recording, channel: str, frequency: float) -> float:
    """Largest amplitude of a channel in the half octave about a frequency [Hz], its units."""
    known = np.isfinite(recording[channel])
    period = recording.period
    time = np.arange(recording.time[0], recording.time[-1], period)
    values = np.interp(time, recording.time[known], recording[channel][known])
    band = [0.8 * frequency, 1.25 * frequency]
    return float(np.abs(sosfiltfilt(butter(2, band, "band", fs=1 / period, output="sos"), values)).max())


def _line(share: np.ndarray, frequency: Sequence[Estimate]) -> tuple[Estimate, Estimate]:
    """f0 [Hz] and s of f = f0 (1 + s share), weighted; errors grow with the scatter about the line."""
    f = np.array([e.value for e in frequency])
    w = 1 / np.array([e.standard_error for e in frequency])
    X = np.column_stack([np.ones(len(f)), share]) * w[:, None]
    x, *_ = np.linalg.lstsq(X, f * w, rcond=None)
    r = X @ x - f * w
    covariance = np.linalg.inv(X.T @ X) * max(1.0, float(r @ r) / max(len(f) - 2, 1))
    small = Estimate(float(x[0]), float(np.sqrt(covariance[0, 0])))
    row = np.array([-x[1] / x[0] ** 2, 1 / x[0]])
    return small, Estimate(float(x[1] / x[0]), float(np.sqrt(row @ covariance @ row)))
