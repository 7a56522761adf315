"""Frequency responses of the link to the motor torque, and the resonances in them.

Cross- and power spectra are those of whole recordings, averaged over a narrow band of frequencies. A recording that
begins and ends at rest has no leakage, so no window in time is applied, and a lightly damped peak is not widened.

    H1 = Syu/Suu        H2 = Syy/Suy        coherence = |Suy|^2/(Suu Syy)

H1 is unbiased by noise on the response, H2 by noise on the torque; Hv lies between (J. S. Bendat and A. G. Piersol,
Random Data). In a closed loop the controller feeds noise of the response back to the torque: there the reference r is
the instrumental variable, H = Syr/Sur.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import find_peaks

from twin.identification.estimates import Estimate
from twin.recording import Recording

SMOOTHING = 0.25
"""Half width of the band over which spectra are averaged [Hz]."""
MIN_BANDWIDTH = 8.0
"""Width of the band that a recording has to excite for a frequency response [Hz]."""
HIGHEST = 45.0
"""Highest frequency of a response [Hz]."""
_MIN_COHERENCE = 0.6  # coherence from which a response is used [1]
_MIN_EXCITATION = 1e-3
"""Power spectrum of the torque over its maximum from which a frequency counts as excited [1]."""
_CHANNELS = ("strain_base", "strain_mid", "tip_deflection")
"""Channels of a response in order of preference."""
_FIT_BAND = 0.15  # half width of the band in which a peak is fitted, over its frequency [1]
_MIN_POINTS = 12  # frequencies that a fit with six linear and two nonlinear unknowns needs
_MAX_FREQUENCY_ERROR = 0.04  # largest relative standard error of the frequency of a peak [1]
_DAMPING_RANGE = (0.001, 0.25)  # damping ratios of a resonance [1]; beyond it a peak is noise or no peak


@dataclass(frozen=True)
class Response:
    """Frequency response of a channel to the torque at n frequencies.

    Attributes:
      recordings: their names.
      channel: of the response.
      frequency: (n) [Hz].
      h1, h2, hv: (n) complex, units of the channel per N m; in a closed loop `h1` is by the instrumental variable.
      coherence: (n) of response and torque [1]; in a closed loop the smaller of their coherences with the reference.
      known: (n) whether the torque excites the frequency and the coherence is sufficient.
      resolution: distance of independent frequencies [Hz].
      by_reference: whether the loop was closed, with the reference as instrumental variable.
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
        """Name of the estimator that `h1` holds."""
        return "by the reference" if self.by_reference else "H1"


@dataclass(frozen=True)
class Peak:
    """A resonance: fitted frequency [Hz] and damping ratio [1], and the largest |H| near it."""

    frequency: Estimate
    damping_ratio: Estimate
    height: float


def frequency_response(
    recordings: Sequence[Recording], channel: str | None = None, least: float = MIN_BANDWIDTH
) -> Response | None:
    """Returns the frequency response by all recordings that excite a broad band; None without any.

    Open-loop recordings are used if there are any, else closed-loop ones with a reference; both from rest, with a free
    hub.

    Args:
      recordings: candidates.
      channel: of the response; None for the first of the link's channels that all have.
      least: width of the band that a recording has to excite [Hz].
    """
    free = [r for r in recordings if not r.clamped and r.start == "rest"]
    for loop in ("open", "closed"):
        chosen = [r for r in free if r.loop == loop and (loop == "open" or "hub_reference" in r)]
        broad = [r for r in chosen if _is_broadband(r, least)]
        names = [channel] if channel else [c for c in _CHANNELS if all(c in r for r in broad)]
        if broad and names:
            return _response(broad, names[0])
    return None


def _is_broadband(recording: Recording, least: float) -> bool:
    """Whether the torque has power over a broad band without a gap."""
    time, torque = _uniform(recording, "torque_command")
    if np.ptp(torque) == 0 or time[-1] - time[0] < 4:
        return False
    f = np.fft.rfftfreq(len(time), time[1] - time[0])
    power = _smooth(np.abs(np.fft.rfft(torque)) ** 2, f[1])
    inside = f < HIGHEST
    # A few steps of the torque excite a broad band too, but with most of the power in a narrow one.
    strong = power[inside] > 0.03 * power[inside].max()
    return float(strong.sum() * f[1]) > least


def _response(recordings: Sequence[Recording], channel: str) -> Response:
    """The response by the summed spectra of recordings that are all of open or all of closed loops."""
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
        # Feedback of noise makes torque and response coherent with each other, but not with the reference.
        rr = s["rr"].real
        coherence = np.minimum(
            np.abs(s["yr"]) ** 2 / (yy * rr + 1e-300), np.abs(s["ur"]) ** 2 / (uu * rr + 1e-300)
        )
    hv = s["yu"] / np.abs(s["yu"] + 1e-300) * np.sqrt(yy / (uu + tiny))
    known = (uu > _MIN_EXCITATION * uu.max()) & (coherence > _MIN_COHERENCE)
    names = tuple(r.name for r in recordings)
    return Response(names, channel, f, h1, h2, hv, coherence, known, 2 * SMOOTHING, closed)


def _uniform(
    recording: Recording, channel: str, period: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Instants [s] and values of a channel on a uniform clock; half a sample is added to the times of a held torque."""
    period = period or recording.period
    time = np.arange(recording.time[0], recording.time[-1], period)
    known = np.isfinite(recording[channel])
    held = 0.5 * recording.period if channel == "torque_command" else 0.0
    return time, np.interp(time, recording.time[known] + held, recording[channel][known])


def _spectrum(recording: Recording, channel: str, period: float, size: int) -> np.ndarray:
    """Discrete Fourier transform of a channel less its first value, zero-padded to `size` samples."""
    _, values = _uniform(recording, channel, period)
    return np.fft.rfft(values - values[0], size)


def _smooth(values: np.ndarray, step: float) -> np.ndarray:
    """The spectrum (n) averaged over a Hann window of half width `SMOOTHING`."""
    return np.convolve(values, _smoothing_kernel(step)[1], "same")


def _smoothing_kernel(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets [Hz] and weights (sum 1) of the Hann window over which a spectrum with this step [Hz] is averaged."""
    half = max(1, round(SMOOTHING / step))
    weights = np.hanning(2 * half + 1)[1:-1]
    return step * np.arange(1 - half, half), weights / weights.sum()


def peaks(response: Response) -> tuple[Peak, ...]:
    """Returns the resonances of a response, by a fit of one mode and a straight line in the band about each peak."""
    size = np.where(response.known, np.abs(response.h1), 0.0)
    if not size.any():
        return ()
    step = response.frequency[1] - response.frequency[0]
    apart = max(1, round(4 * SMOOTHING / step))
    tops, _ = find_peaks(np.log(size + 1e-3 * size.max()), prominence=0.3, distance=apart)
    fitted = [_fit_peak(response, float(response.frequency[k])) for k in tops]
    determined = [p for p in fitted if p is not None and _is_well_determined(p)]
    # Of fits that ended at one resonance the most accurate is kept.
    kept: list[Peak] = []
    for peak in sorted(determined, key=lambda p: p.frequency.standard_error):
        if all(abs(peak.frequency.value - k.frequency.value) > 4 * SMOOTHING for k in kept):
            kept.append(peak)
    return tuple(sorted(kept, key=lambda p: p.frequency.value))


def _is_well_determined(peak: Peak) -> bool:
    """Whether the frequency is accurate and the damping ratio exceeds two standard errors."""
    f, zeta = peak.frequency, peak.damping_ratio
    return f.standard_error < _MAX_FREQUENCY_ERROR * f.value and zeta.value > 2 * zeta.standard_error


@dataclass(frozen=True)
class _PeakModel:
    """Model of a response near a resonance: R w0^2/(w0^2 - w^2 + 2 i zeta w0 w) + a + b w, R, a, b complex.

    The mode is averaged over frequency with the window of the spectra. R, a and b are linear and eliminated.

    Attributes:
      omega: (n) angular frequencies [rad/s].
      response: (n) complex.
      weight: (n) one over the standard deviation of the response, up to a common factor.
      centre: angular frequency to start from [rad/s].
      offsets, window: of the smoothing [Hz], [1].
    """

    omega: np.ndarray
    response: np.ndarray
    weight: np.ndarray
    centre: float
    offsets: np.ndarray
    window: np.ndarray

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Weighted residual (2 n), real and imaginary, at z = (w0/centre, zeta)."""
        X = self._columns(z) * self.weight[:, None]
        r = X @ np.linalg.lstsq(X, self.response * self.weight, rcond=None)[0] - self.response * self.weight
        return np.concatenate([r.real, r.imag])

    def _columns(self, z: np.ndarray) -> np.ndarray:
        """Mode, constant and line (n x 3)."""
        w = self.omega[:, None] + 2 * math.pi * self.offsets
        w0 = self.centre * z[0]
        mode = w0**2 / (w0**2 - w**2 + 2j * z[1] * w0 * w) @ self.window
        return np.column_stack([mode, np.ones(len(self.omega)), self.omega / self.centre - 1])


def _fit_peak(response: Response, guess: float) -> Peak | None:
    """Fits one mode about a peak [Hz]; None where the fit ends outside the band or is no lightly damped mode."""
    model = _peak_model(response, guess)
    if len(model.omega) < _MIN_POINTS:
        return None
    low, high = [1 - _FIT_BAND, _DAMPING_RANGE[0] / 2], [1 + _FIT_BAND, 2 * _DAMPING_RANGE[1]]
    fits = (least_squares(model.residual, [1.0, zeta], bounds=(low, high)) for zeta in (0.01, 0.05))
    best = min(fits, key=lambda fit: fit.cost)
    ratio = float(best.x[1])
    inside = abs(float(best.x[0]) - 1) < 0.9 * _FIT_BAND
    if not (inside and _DAMPING_RANGE[0] < ratio < _DAMPING_RANGE[1]):
        return None
    errors = _standard_errors(best, response)
    frequency = Estimate(guess * float(best.x[0]), guess * float(errors[0]))
    return Peak(frequency, Estimate(ratio, float(errors[1])), float(np.abs(model.response).max()))


def _peak_model(response: Response, guess: float) -> _PeakModel:
    """The response in the fit band about a peak [Hz], weighted by its coherence."""
    near = np.abs(response.frequency / guess - 1) < _FIT_BAND
    near &= response.known
    h = response.h1[near]
    # var(H)/|H|^2 is about (1 - c)/c (Bendat and Piersol).
    c = np.clip(response.coherence[near], 0.01, 0.9999)
    weight = np.sqrt(c / (1 - c)) / np.abs(h)
    offsets, window = _smoothing_kernel(response.frequency[1] - response.frequency[0])
    return _PeakModel(2 * math.pi * response.frequency[near], h, weight, 2 * math.pi * guess, offsets, window)


def _standard_errors(fit: OptimizeResult, response: Response) -> np.ndarray:
    """Standard errors of (w0/centre, zeta); frequencies within the resolution count as one."""
    correlated = max(1.0, response.resolution / (response.frequency[1] - response.frequency[0]))
    J = np.asarray(fit.jac)
    free = max(len(fit.fun) / correlated - 8, 1.0)
    covariance = np.linalg.pinv(J.T @ J / correlated) * (2 * fit.cost / correlated / free)
    return np.sqrt(np.diag(covariance))
