"""Damping from a free vibration of the link, by its envelope and by a fit of the whole decay.

A sine is fitted to every period: its amplitudes are the envelope, its phases give the frequency. The envelope obeys
a_t = -(c0 + c1 a + c2 a^2), with c0 by dry friction, c1 by losses proportional to the rate (material, oil) and c2 by
turbulent air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from twin.identification.estimates import Estimate
from twin.recording import Recording, sample_period

Law = Literal["proportional", "dry friction", "square of the rate"]

MIN_PERIODS = 4
"""Periods that a decay needs: its envelope has up to three unknowns."""
_LINK_CHANNELS = ("strain_base", "tip_deflection", "strain_mid", "tip_acceleration")
"""Channels of the link in order of preference."""
_MIN_AMPLITUDE = 8.0  # amplitude of a period that is used, in its standard errors
_MIN_LOSS_SIGNIFICANCE = 4.0  # value of a second loss term that is accepted, in its standard errors
_PRIOR_SLOPE = 0.03  # prior standard deviation of the relative change of frequency at the first amplitude [1]
_EXPONENTS: dict[Law, int] = {"dry friction": 0, "square of the rate": 2}
"""Exponent of the amplitude in the second loss term of each law."""


@dataclass(frozen=True)
class Decay:
    """A ring-down with its frequency and losses; n samples, m periods.

    Attributes:
      recording, channel: its source.
      time, values: (n) instants [s] and vibration without its mean, units of the channel.
      period_centre: (m) [s].
      amplitude, amplitude_error: (m) amplitude of each period and its standard error, units of the channel.
      frequency: at amplitude zero [Hz].
      damping_ratio: by the envelope at half its first amplitude [1].
      by_decrement, by_fit: damping ratio by the logarithmic decrement, and by one damped sine for the whole decay [1].
      law: the significant loss term beside the proportional one, or "proportional".
      law_significance: value of that term in its standard errors; 0 for "proportional".
      losses: (3) c0, c1, c2.
      frequency_slope: relative change of the frequency at the first amplitude [1].
    """

    recording: str
    channel: str
    time: np.ndarray
    values: np.ndarray
    period_centre: np.ndarray
    amplitude: np.ndarray
    amplitude_error: np.ndarray
    frequency: Estimate
    damping_ratio: Estimate
    by_decrement: Estimate
    by_fit: Estimate
    law: Law
    law_significance: float
    losses: np.ndarray
    frequency_slope: Estimate


def link_channel(recording: Recording) -> str | None:
    """The channel from which the vibration of the link is read: the first one with more than 50 readings; else None."""
    return next((c for c in _LINK_CHANNELS if c in recording and np.isfinite(recording[c]).sum() > 50), None)


def fit_ring_down(recording: Recording, channel: str, first: float, last: float) -> Decay | None:
    """Returns the decay of a free vibration between two instants [s]; None if it has fewer than `MIN_PERIODS`."""
    inside = (recording.time >= first) & (recording.time <= last) & np.isfinite(recording[channel])
    time, values = recording.time[inside], np.array(recording[channel][inside])
    if len(time) < 20:
        return None
    guess = _dominant_frequency(time, values)
    if guess is None or (time[-1] - time[0]) * guess < MIN_PERIODS:
        return None
    frequency, rate = _fit_damped_sine(time, values, guess)
    if frequency is None or rate is None:
        return None
    periods = _fit_periods(time, values, frequency.value)
    if periods is None:
        return None
    middle, amplitude, error, phase, phase_error = periods
    law, significance, losses, envelope_rate = _select_loss_law(middle, amplitude, error)
    small, slope = _frequency_by_amplitude(middle, amplitude, phase, phase_error, frequency.value)
    omega = 2 * math.pi * small.value
    decrement = _logarithmic_decrement(middle, amplitude, error)
    return Decay(
        recording.name,
        channel,
        time,
        values - values.mean(),
        middle,
        amplitude,
        error,
        small,
        _damping_ratio(envelope_rate, omega),
        _damping_ratio(decrement, omega),
        _damping_ratio(rate, omega),
        law,
        significance,
        losses,
        slope,
    )


def _damping_ratio(rate: Estimate, omega: float) -> Estimate:
    """Damping ratio [1] of a decay rate [1/s] at an angular frequency [rad/s]."""
    return Estimate(rate.value / omega, rate.standard_error / omega)


def _dominant_frequency(time: np.ndarray, values: np.ndarray) -> float | None:
    """Frequency of the largest spectral line above two cycles per record [Hz], trend removed; None without one."""
    period = sample_period(time)
    grid = np.arange(time[0], time[-1], period)
    uniform = np.interp(grid, time, values)
    swing = (uniform - np.polyval(np.polyfit(grid, uniform, 1), grid)) * np.hanning(len(grid))
    size = 8 * len(grid)
    f, power = np.fft.rfftfreq(size, period), np.abs(np.fft.rfft(swing, size))
    seen = f > 2 / (time[-1] - time[0])
    if not seen.any() or not power[seen].max() > 0:
        return None
    return float(f[seen][np.argmax(power[seen])])


def _fit_damped_sine(
    time: np.ndarray, values: np.ndarray, guess: float
) -> tuple[Estimate | None, Estimate | None]:
    """Frequency [Hz] and decay rate [1/s] of one damped sine and an offset, fitted to all samples.

    Amplitudes and offset are linear and eliminated (variable projection). None where the fit is singular.

    Args:
      time, values: (n) instants [s] and vibration.
      guess: frequency to start from [Hz].
    """
    t = time - time[0]
    # Scaled to order one for the tolerances of the least-squares routine.
    y = (values - values.mean()) / (values.std() or 1.0)

    def residual(z: np.ndarray) -> np.ndarray:
        X = _damped_sine_basis(t, 2 * math.pi * z[0], z[1])
        return X @ np.linalg.lstsq(X, y, rcond=None)[0] - y

    best = None
    for rate in (0.003, 0.03):
        start = [guess, rate * 2 * math.pi * guess]
        low, high = [0.7 * guess, 0.0], [1.4 * guess, 2 * math.pi * guess]
        fit = least_squares(residual, start, bounds=(low, high), x_scale=[guess, guess])
        best = fit if best is None or fit.cost < best.cost else best
    assert best is not None
    J = np.asarray(best.jac)
    information = J.T @ J
    if np.linalg.cond(information) > 1e15:
        return None, None
    covariance = np.linalg.inv(information) * _effective_variance(best.fun)
    errors = np.sqrt(np.diag(covariance))
    return Estimate(float(best.x[0]), float(errors[0])), Estimate(float(best.x[1]), float(errors[1]))


def _damped_sine_basis(t: np.ndarray, omega: float, rate: float) -> np.ndarray:
    """Damped cosine, damped sine and offset (n x 3)."""
    decay = np.exp(-rate * t)
    return np.column_stack([decay * np.cos(omega * t), decay * np.sin(omega * t), np.ones(len(t))])


def _effective_variance(residual: np.ndarray) -> float:
    """Variance of a residual times its integrated autocorrelation time.

    The autocorrelation is summed up to its first zero crossing; samples of a slow unmodelled component then do not
    count as independent.
    """
    r = residual - residual.mean()
    size = 1 << (2 * len(r)).bit_length()
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    correlation = np.fft.irfft(spectrum)[: len(r) // 2]
    correlation = correlation / correlation[0] if correlation[0] > 0 else correlation
    below = np.flatnonzero(correlation <= 0)
    reach = int(below[0]) if len(below) else len(correlation)
    return float(r @ r) / max(len(r) - 5, 1) * max(1.0, 2 * float(correlation[:reach].sum()) - 1)


def _fit_periods(time: np.ndarray, values: np.ndarray, frequency: float) -> tuple[np.ndarray, ...] | None:
    """Centre [s], amplitude, its error, phase [rad] and its error of every period (m each).

    Ends before the first period whose amplitude is below `_MIN_AMPLITUDE` errors; None with fewer than `MIN_PERIODS`.
    """
    omega, count = 2 * math.pi * frequency, int((time[-1] - time[0]) * frequency)
    rows = []
    for k in range(count):
        inside = (time >= time[0] + k / frequency) & (time < time[0] + (k + 1) / frequency)
        if inside.sum() < 8:
            continue
        t = time[inside]
        middle = time[0] + (k + 0.5) / frequency
        # With a slope beside the offset, a slow oscillation does not look like a decay.
        X = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones(len(t)), t - middle])
        x, *_ = np.linalg.lstsq(X, values[inside], rcond=None)
        r = values[inside] - X @ x
        size = math.hypot(x[0], x[1])
        covariance = np.linalg.inv(X.T @ X)[:2, :2] * _effective_variance(r)
        along = x[:2] / max(size, 1e-300)
        across = np.array([-along[1], along[0]])
        error, tangential = (math.sqrt(v @ covariance @ v) for v in (along, across))
        if not size > _MIN_AMPLITUDE * error:
            break
        rows.append((middle, size, error, math.atan2(-x[1], x[0]), tangential / size))
    if len(rows) < MIN_PERIODS:
        return None
    middle, amplitude, error, phase, phase_error = np.array(rows).T
    return middle, amplitude, error, np.unwrap(phase), phase_error


def _logarithmic_decrement(middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray) -> Estimate:
    """Decay rate [1/s] by a weighted line through the logarithms of the amplitudes."""
    w = amplitude / error
    X = np.column_stack([np.ones(len(middle)), middle - middle.mean()])
    x, *_ = np.linalg.lstsq(X * w[:, None], np.log(amplitude) * w, rcond=None)
    r = (np.log(amplitude) - X @ x) * w
    scale = max(1.0, float(r @ r) / max(len(r) - 2, 1))
    covariance = np.linalg.inv((X * w[:, None]).T @ (X * w[:, None])) * scale
    return Estimate(-float(x[1]), math.sqrt(covariance[1, 1]))


def _select_loss_law(
    middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray
) -> tuple[Law, float, np.ndarray, Estimate]:
    """Loss law of an envelope, its significance, (c0, c1, c2), and the decay rate at half the first amplitude [1/s].

    A second loss term is accepted where it exceeds `_MIN_LOSS_SIGNIFICANCE` standard errors and lowers chi-squared.
    """
    plain = _fit_losses(middle, amplitude, error, ())
    best: tuple[Law, float, _LossFit] = ("proportional", 0.0, plain)
    for law, term in _EXPONENTS.items():
        fit = _fit_losses(middle, amplitude, error, (term,))
        spread = math.sqrt(max(fit.covariance[1, 1], 1e-300))
        significance = fit.x[1] / spread
        if significance > _MIN_LOSS_SIGNIFICANCE and fit.cost < (best[2].cost if best[1] else plain.cost):
            best = (law, significance, fit)
    law, significance, fit = best
    a = amplitude[0] / 2
    losses, row = np.zeros(3), np.zeros(len(fit.x))
    losses[1], row[0] = fit.x[0], 1.0
    if law != "proportional":
        losses[_EXPONENTS[law]], row[1] = fit.x[1], a ** (_EXPONENTS[law] - 1)
    rate = float(row @ fit.x)
    return law, significance, losses, Estimate(rate, math.sqrt(row @ fit.covariance @ row))


@dataclass(frozen=True)
class _LossFit:
    """Fitted losses (c1, then the second term), their covariance, and chi-squared."""

    x: np.ndarray
    covariance: np.ndarray
    cost: float


def _fit_losses(
    middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray, terms: tuple[int, ...]
) -> _LossFit:
    """Fits a_t = -(c1 a + c a^term) and the first amplitude, with non-negative losses.

    Errors grow by the root of the reduced chi-squared where that exceeds 1.
    """
    t = middle - middle[0]
    span = max(t[-1], 1e-9)
    rate = max(math.log(amplitude[0] / amplitude[-1]) / span, 1e-3 / span)
    # Scaled to order one: a by its first value, losses by the mean decay rate.
    u, sigma = amplitude / amplitude[0], error / amplitude[0]

    def envelope(z: np.ndarray) -> np.ndarray:
        if not terms:
            return z[0] * np.exp(-rate * z[1] * t)
        power = terms[0]

        def slope(_: float, y: np.ndarray) -> np.ndarray:
            y = np.maximum(y, 0)
            return -rate * (z[1] * y + z[2] * y**power)

        return solve_ivp(slope, (0.0, span), [z[0]], t_eval=t, rtol=1e-6, atol=1e-9).y[0]

    start = np.array([1.0, 1.0, 0.05][: 2 + len(terms)])

    def residual(z: np.ndarray) -> np.ndarray:
        return (envelope(z) - u) / sigma

    fit = least_squares(residual, start, bounds=(0, np.inf))
    J = np.asarray(fit.jac)
    scale = max(1.0, 2 * fit.cost / max(len(t) - len(start), 1))
    covariance = np.linalg.pinv(J.T @ J)[1:, 1:] * scale
    units = np.array([rate, *(rate * amplitude[0] ** (1 - p) for p in terms)])
    return _LossFit(fit.x[1:] * units, covariance * np.outer(units, units), 2 * float(fit.cost))


def _frequency_by_amplitude(
    middle: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, phase_error: np.ndarray, reference: float
) -> tuple[Estimate, Estimate]:
    """f0 [Hz] and s of f = f0 (1 + s (a/a0)^2), from the phase of the periods.

    Relative to a sine of the reference frequency [Hz] the phase grows at 2 pi (f - f_ref).
    """
    share = (amplitude / amplitude[0]) ** 2
    integral = np.concatenate([[0.0], np.cumsum(np.diff(middle) * (share[1:] + share[:-1]) / 2)])
    t = middle - middle[0]
    w = 1 / phase_error
    X = np.column_stack([np.ones(len(t)), 2 * math.pi * t, 2 * math.pi * integral])
    # Prior on s: in an elastic link the frequency changes by percents. It decides where the record does not.
    prior = np.array([0.0, 0.0, 1 / (_PRIOR_SLOPE * reference)])
    solve = np.vstack([X * w[:, None], prior])
    x, *_ = np.linalg.lstsq(solve, np.r_[(phase - phase[0]) * w, 0.0], rcond=None)
    r = (phase - phase[0] - X @ x) * w
    scale = max(1.0, float(r @ r) / max(len(t) - 3, 1))
    errors = np.sqrt(np.diag(np.linalg.pinv(solve.T @ solve) * scale))
    small = reference + float(x[1])
    return Estimate(small, float(errors[1])), Estimate(float(x[2]) / small, float(errors[2]) / small)
