"""Frequency responses of the link to the torque, and the modes in them.

From cross- and power spectra of whole recordings, smoothed over a narrow band of frequencies: a recording that begins
and ends at rest has no leakage, so none is windowed away, and a lightly damped peak stays as narrow as it is.

    H1 = Syu/Suu        H2 = Syy/Suy        coherence = |Suy|^2/(Suu Syy)

H1 is right where noise is on the response only, H2 where it is on the torque only, Hv in between (J. S. Bendat and
A. G. Piersol, Random Data). In a closed loop noise comes round to the torque: there the reference r is the
instrument, H = Syr/Sur.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from twin.identification.estimates import Estimate
from twin.recording import Recording

SMOOTHING = 0.25
"""Half width of the band over which spectra are averaged [Hz]."""
BROAD = 8.0
"""Width of the band that a recording excites at least to count by itself [Hz]."""
HIGHEST = 45.0  # Hz
_COHERENT = 0.6  # coherence from which a response is believed
_EXCITED = 1e-3  # share of the strongest torque spectrum above which a frequency is excited
_CHANNELS = ("strain_base", "strain_mid", "tip_deflection")
_SPAN = 0.15  # relative width of the band in which a peak is fitted, to either side
_SURE = 0.04  # relative error of a frequency up to which a peak counts
_LIGHT = (0.001, 0.25)  # damping ratios between which a peak is a mode


@dataclass(frozen=True)
class Response:
    """Frequency response of a channel to the torque.

    Attributes:
      recordings: names.
      channel: of the response.
      frequency: (n) [Hz].
      h1, h2, hv: (n) complex, units of the channel per N m; of a closed loop `h1` is by the reference.
      coherence: (n) of response and torque [1]; of a closed loop the smaller of theirs with the reference.
      known: (n) where the torque excites and the coherence is good.
      resolution: distance of frequencies that are independent [Hz].
      by_reference: whether the loop was closed and its reference the instrument.
    """

    recordings: tuple[str, ...]
    channel: str
    frequency: np.ndarray
    h1: np.ndarray
    h2: np.ndarray
    hv: np.ndarray
    coherence: np.ndarray
    known: np.ndarray
    resolution: float
    by_reference: bool = False

    @property
    def estimator(self) -> str:
        """What `h1` is called."""
        return "by the reference" if self.by_reference else "H1"


@dataclass(frozen=True)
class Peak:
    """A resonance: frequency [Hz] and damping ratio [1], fitted, and the response there, units of the response."""

    frequency: Estimate
    damping_ratio: Estimate
    height: float


def response(
    recordings: Sequence[Recording], channel: str | None = None, least: float = BROAD
) -> Response | None:
    """The frequency response by all recordings that excite a broad band; None where there are none.

    Args:
      recordings: those with a locked hub are left out; open and closed loops are not mixed: open ones come first.
      channel: of the link; by default the first that all have.
      least: width of the band that a recording has to excite [Hz].
    """
    free = [r for r in recordings if not r.clamped and r.start == "rest"]
    for loop in ("open", "closed"):
        chosen = [r for r in free if r.loop == loop and (loop == "open" or "hub_reference" in r)]
        names = [channel] if channel else [c for c in _CHANNELS if all(c in r for r in chosen)]
        broad = [r for r in chosen if names and _excites(r, least)]
        if broad:
            return _response(broad, names[0])
    return None


def _excites(recording: Recording, least: float) -> bool:
    """Whether the torque has power over a broad band without a gap."""
    time, torque = _uniform(recording, "torque_command")
    if np.ptp(torque) == 0 or time[-1] - time[0] < 4:
        return False
    f = np.fft.rfftfreq(len(time), time[1] - time[0])
    power = _smooth(np.abs(np.fft.rfft(torque)) ** 2, f[1])
    inside = f < HIGHEST
    # A few steps excite a broad band too, but hardly more than a line of it.
    strong = power[inside] > 0.03 * power[inside].max()
    return float(strong.sum() * f[1]) > least


def _response(recordings: Sequence[Recording], channel: str) -> Response:
    period = max(r.period for r in recordings)
    size = int(2 ** math.ceil(math.log2(max(r.duration for r in recordings) / period)))
    f = np.fft.rfftfreq(size, period)
    spectra = {key: np.zeros(len(f), dtype=complex) for key in ("uu", "yy", "rr", "yu", "yr", "ur")}
    for r in recordings:
        U, Y = (_spectrum(r, name, period, size) for name in ("torque_command", channel))
        R = _spectrum(r, "hub_reference", period, size) if r.loop == "closed" else U
        pairs = {"uu": (U, U), "yy": (Y, Y), "rr": (R, R), "yu": (Y, U), "yr": (Y, R), "ur": (U, R)}
        for key, (a, b) in pairs.items():
            spectra[key] += _smooth(a * np.conj(b), f[1])
    inside = (f > 0.3) & (f < min(HIGHEST, 0.4 / period))
    f = f[inside]
    s = {key: values[inside] for key, values in spectra.items()}
    uu, yy = s["uu"].real, s["yy"].real
    tiny = 1e-12 * uu.max()
    h1, h2 = s["yr"] / (s["ur"] + tiny), yy / (np.conj(s["yu"]) + 1e-300)
    closed = any(r.loop == "closed" for r in recordings)
    coherence = np.abs(s["yu"]) ** 2 / (uu * yy + 1e-300)
    if closed:
        # Feedback makes torque and response alike without any reference.
        rr = s["rr"].real
        coherence = np.minimum(
            np.abs(s["yr"]) ** 2 / (yy * rr + 1e-300), np.abs(s["ur"]) ** 2 / (uu * rr + 1e-300)
        )
    hv = s["yu"] / np.abs(s["yu"] + 1e-300) * np.sqrt(yy / (uu + tiny))
    known = (uu > _EXCITED * uu.max()) & (coherence > _COHERENT)
    names = tuple(r.name for r in recordings)
    return Response(names, channel, f, h1, h2, hv, coherence, known, 2 * SMOOTHING, closed)


def _uniform(
    recording: Recording, channel: str, period: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The channel on a uniform clock; a torque is held, so that half a sample is added to its instants."""
    period = period or recording.period
    time = np.arange(recording.time[0], recording.time[-1], period)
    known = np.isfinite(recording[channel])
    held = 0.5 * period if channel == "torque_command" else 0.0
    return time, np.interp(time, recording.time[known] + held, recording[channel][known])


def _spectrum(recording: Recording, channel: str, period: float, size: int) -> np.ndarray:
    _, values = _uniform(recording, channel, period)
    return np.fft.rfft(values - values[0], size)


def _smooth(values: np.ndarray, step: float) -> np.ndarray:
    """The spectrum (n) averaged over a Hann window of half width `SMOOTHING`."""
    return np.convolve(values, _window(step)[1], "same")


def _window(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances [Hz] and weights, of sum 1, over which a spectrum with this step [Hz] is averaged."""
    half = max(1, round(SMOOTHING / step))
    weights = np.hanning(2 * half + 1)[1:-1]
    return step * np.arange(1 - half, half), weights / weights.sum()


def peaks(found: Response) -> tuple[Peak, ...]:
    """The resonances of a response, by a mode and a straight line fitted in the band about each."""
    size = np.where(found.known, np.abs(found.h1), 0.0)
    if not size.any():
        return ()
    step = found.frequency[1] - found.frequency[0]
    apart = max(1, round(4 * SMOOTHING / step))
    tops, _ = find_peaks(np.log(size + 1e-3 * size.max()), prominence=0.3, distance=apart)
    fitted = [_fit_peak(found, float(found.frequency[k])) for k in tops]
    sure = [p for p in fitted if p is not None and _is_sure(p)]
    kept: list[Peak] = []
    for peak in sorted(sure, key=lambda p: p.frequency.standard_error):
        if all(abs(peak.frequency.value - k.frequency.value) > 4 * SMOOTHING for k in kept):
            kept.append(peak)
    return tuple(sorted(kept, key=lambda p: p.frequency.value))


def _is_sure(peak: Peak) -> bool:
    f, zeta = peak.frequency, peak.damping_ratio
    return f.standard_error < _SURE * f.value and zeta.value > 2 * zeta.standard_error


def _fit_peak(found: Response, guess: float) -> Peak | None:
    """Fits R/(w0^2 - w^2 + 2 i z w0 w) + a + b w, R, a, b complex, about a peak [Hz]; None where it is no mode."""
    near = np.abs(found.frequency / guess - 1) < _SPAN
    near &= found.known
    omega, h = 2 * math.pi * found.frequency[near], found.h1[near]
    if len(omega) < 12:
        return None
    # Where the coherence is poor, noise is large: var(H)/|H|^2 is about (1 - c)/c.
    c = np.clip(found.coherence[near], 0.01, 0.9999)
    weight = np.sqrt(c / (1 - c)) / np.abs(h)
    centre = 2 * math.pi * guess

    # The response was averaged over a narrow band: so is the mode.
    offsets, window = _window(found.frequency[1] - found.frequency[0])
    w = omega[:, None] + 2 * math.pi * offsets

    def parts(z: np.ndarray) -> np.ndarray:
        w0 = centre * z[0]
        mode = w0**2 / (w0**2 - w**2 + 2j * z[1] * w0 * w) @ window
        return np.column_stack([mode, np.ones(len(omega)), omega / centre - 1])

    def off(z: np.ndarray) -> np.ndarray:
        X = parts(z) * weight[:, None]
        r = X @ np.linalg.lstsq(X, h * weight, rcond=None)[0] - h * weight
        return np.concatenate([r.real, r.imag])

    low, high = [1 - _SPAN, _LIGHT[0] / 2], [1 + _SPAN, 2 * _LIGHT[1]]
    best = min(
        (least_squares(off, [1.0, zeta], bounds=(low, high)) for zeta in (0.01, 0.05)), key=lambda r: r.cost
    )
    ratio = float(best.x[1])
    inside = abs(float(best.x[0]) - 1) < 0.9 * _SPAN
    if not (inside and _LIGHT[0] < ratio < _LIGHT[1]):
        return None
    # Neighbours within the smoothing are one piece of evidence.
    alike = max(1.0, found.resolution / (found.frequency[1] - found.frequency[0]))
    J = np.asarray(best.jac)
    free = max(len(best.fun) / alike - 8, 1.0)
    covariance = np.linalg.pinv(J.T @ J / alike) * (2 * best.cost / alike / free)
    errors = np.sqrt(np.diag(covariance))
    frequency = Estimate(guess * float(best.x[0]), guess * float(errors[0]))
    height = float(np.abs(h).max())
    return Peak(frequency, Estimate(ratio, float(errors[1])), height)
