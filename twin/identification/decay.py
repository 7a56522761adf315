"""Damping from free vibration: a ring-down of the clamped link, by its envelope and by a fit of the whole decay.

Over one period the vibration is a sine; its amplitude and phase, period after period, are the envelope and the
frequency. An amplitude a that falls as a_t = -(c0 + c1 a + c2 a^2) has dry friction in c0, losses in proportion to
the rate (material, oil) in c1 and turbulent air in c2: which of them the envelope needs tells where the energy goes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from twin.identification.estimates import Estimate
from twin.recording import Recording

Law = Literal["proportional", "dry friction", "square of the rate"]

LEAST_PERIODS = 4
_LINK_CHANNELS = ("strain_base", "tip_deflection", "strain_mid", "tip_acceleration")
_SEEN = 8.0  # errors of an amplitude above which a period counts
_NEEDED = 4.0  # errors from zero at which a second loss is believed
_SLOPE = (
    0.03  # standard deviation of the relative change of the frequency with amplitude, before it is measured
)
_TERMS: dict[Law, int] = {"dry friction": 0, "square of the rate": 2}


@dataclass(frozen=True)
class Decay:
    """A ring-down and what it says.

    Attributes:
      recording, channel: where it was seen.
      time, values: (n) the vibration, its mean taken out.
      middle: (m) middles of the periods [s].
      amplitude, amplitude_error: (m) of the vibration, in units of the channel.
      frequency: of small vibration [Hz].
      damping_ratio: by the envelope's decay at half its first amplitude.
      by_decrement, by_fit: the same by the logarithmic decrement, and by a fit of the whole decay.
      law: the loss that the envelope needs beside the proportional one, or "proportional".
      law_significance: standard errors by which that loss is not zero; 0 where there is none.
      losses: (3) c0, c1, c2 of the envelope.
      frequency_slope: relative change of the frequency per unit of squared amplitude, over its first value [1].
    """

    recording: str
    channel: str
    time: np.ndarray
    values: np.ndarray
    middle: np.ndarray
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
    """The channel that shows the link's vibration best: the first of the known ones that has readings."""
    return next((c for c in _LINK_CHANNELS if c in recording and np.isfinite(recording[c]).sum() > 50), None)


def ring_down(recording: Recording, channel: str, first: float, last: float) -> Decay | None:
    """Returns the decay of a free vibration between two instants [s]; None where too few periods are seen."""
    inside = (recording.time >= first) & (recording.time <= last) & np.isfinite(recording[channel])
    time, values = recording.time[inside], np.array(recording[channel][inside])
    if len(time) < 20:
        return None
    guess = _loudest(time, values)
    if guess is None or (time[-1] - time[0]) * guess < LEAST_PERIODS:
        return None
    frequency, rate = _whole_fit(time, values, guess)
    if frequency is None or rate is None:
        return None
    periods = _periods(time, values, frequency.value)
    if periods is None:
        return None
    middle, amplitude, error, phase, phase_error = periods
    law, significance, losses, envelope_rate = _envelope(middle, amplitude, error)
    small, slope = _frequency_by_amplitude(middle, amplitude, phase, phase_error, frequency.value)
    omega = 2 * math.pi * small.value
    decrement = _decrement(middle, amplitude, error)
    return Decay(
        recording.name,
        channel,
        time,
        values - values.mean(),
        middle,
        amplitude,
        error,
        small,
        _over(envelope_rate, omega),
        _over(decrement, omega),
        _over(rate, omega),
        law,
        significance,
        losses,
        slope,
    )


def _over(rate: Estimate, omega: float) -> Estimate:
    return Estimate(rate.value / omega, rate.standard_error / omega)


def _loudest(time: np.ndarray, values: np.ndarray) -> float | None:
    """Frequency of the strongest line [Hz] on a uniform grid; None where it is at the edge of the spectrum."""
    period = float(np.median(np.diff(time)))
    grid = np.arange(time[0], time[-1], period)
    uniform = np.interp(grid, time, values)
    swing = (uniform - np.polyval(np.polyfit(grid, uniform, 1), grid)) * np.hanning(len(grid))
    size = 8 * len(grid)
    f, power = np.fft.rfftfreq(size, period), np.abs(np.fft.rfft(swing, size))
    seen = f > 2 / (time[-1] - time[0])
    if not seen.any() or not power[seen].max() > 0:
        return None
    return float(f[seen][np.argmax(power[seen])])


def _whole_fit(time: np.ndarray, values: np.ndarray, guess: float) -> tuple[Estimate | None, Estimate | None]:
    """Frequency [Hz] and decay rate [1/s] of one damped sine and an offset, fitted to all samples."""
    t = time - time[0]
    # Of order one, as the tolerances of the search expect.
    y = (values - values.mean()) / (values.std() or 1.0)

    def residual(z: np.ndarray) -> np.ndarray:
        X = _damped(t, 2 * math.pi * z[0], z[1])
        return X @ np.linalg.lstsq(X, y, rcond=None)[0] - y

    best = None
    for rate in (0.003, 0.03):
        start = [guess, rate * 2 * math.pi * guess]
        low, high = [0.7 * guess, 0.0], [1.4 * guess, 2 * math.pi * guess]
        found = least_squares(residual, start, bounds=(low, high), x_scale=[guess, guess])
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    J = np.asarray(best.jac)
    information = J.T @ J
    if np.linalg.cond(information) > 1e15:
        return None, None
    covariance = np.linalg.inv(information) * _independent_variance(best.fun)
    errors = np.sqrt(np.diag(covariance))
    return Estimate(float(best.x[0]), float(errors[0])), Estimate(float(best.x[1]), float(errors[1]))


def _damped(t: np.ndarray, omega: float, rate: float) -> np.ndarray:
    fall = np.exp(-rate * t)
    return np.column_stack([fall * np.cos(omega * t), fall * np.sin(omega * t), np.ones(len(t))])


def _independent_variance(residual: np.ndarray) -> float:
    """Variance of a residual, enlarged by its correlation: by the sum of its autocorrelations up to the first
    negative one, so that an unmodelled wiggle does not pass for many samples' worth of evidence."""
    r = residual - residual.mean()
    size = 1 << (2 * len(r)).bit_length()
    spectrum = np.abs(np.fft.rfft(r, size)) ** 2
    correlation = np.fft.irfft(spectrum)[: len(r) // 2]
    correlation = correlation / correlation[0] if correlation[0] > 0 else correlation
    below = np.flatnonzero(correlation <= 0)
    reach = int(below[0]) if len(below) else len(correlation)
    return float(r @ r) / max(len(r) - 5, 1) * max(1.0, 2 * float(correlation[:reach].sum()) - 1)


def _periods(time: np.ndarray, values: np.ndarray, frequency: float) -> tuple[np.ndarray, ...] | None:
    """Middle (m), amplitude, its error, phase [rad] and its error of every period, up to the first that noise hides."""
    omega, count = 2 * math.pi * frequency, int((time[-1] - time[0]) * frequency)
    rows = []
    for k in range(count):
        inside = (time >= time[0] + k / frequency) & (time < time[0] + (k + 1) / frequency)
        if inside.sum() < 8:
            continue
        t = time[inside]
        middle = time[0] + (k + 0.5) / frequency
        # A slope beside the offset: what is left of a slow swing is not taken for a decay.
        X = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones(len(t)), t - middle])
        x, *_ = np.linalg.lstsq(X, values[inside], rcond=None)
        r = values[inside] - X @ x
        size = math.hypot(x[0], x[1])
        covariance = np.linalg.inv(X.T @ X)[:2, :2] * _independent_variance(r)
        along = x[:2] / max(size, 1e-300)
        across = np.array([-along[1], along[0]])
        error, turn = (math.sqrt(v @ covariance @ v) for v in (along, across))
        if not size > _SEEN * error:
            break
        rows.append((middle, size, error, math.atan2(-x[1], x[0]), turn / size))
    if len(rows) < LEAST_PERIODS:
        return None
    middle, amplitude, error, phase, phase_error = np.array(rows).T
    return middle, amplitude, error, np.unwrap(phase), phase_error


def _decrement(middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray) -> Estimate:
    """Decay rate [1/s] by the line through the logarithms of the amplitudes, weighted by their errors."""
    w = amplitude / error
    X = np.column_stack([np.ones(len(middle)), middle - middle.mean()])
    x, *_ = np.linalg.lstsq(X * w[:, None], np.log(amplitude) * w, rcond=None)
    r = (np.log(amplitude) - X @ x) * w
    scale = max(1.0, float(r @ r) / max(len(r) - 2, 1))
    covariance = np.linalg.inv((X * w[:, None]).T @ (X * w[:, None])) * scale
    return Estimate(-float(x[1]), math.sqrt(covariance[1, 1]))


def _envelope(
    middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray
) -> tuple[Law, float, np.ndarray, Estimate]:
    """The law of the losses, its significance, c0 c1 c2, and the decay rate at half the first amplitude [1/s]."""
    plain = _fit_losses(middle, amplitude, error, ())
    best: tuple[Law, float, _Losses] = ("proportional", 0.0, plain)
    for law, term in _TERMS.items():
        found = _fit_losses(middle, amplitude, error, (term,))
        spread = math.sqrt(max(found.covariance[1, 1], 1e-300))
        significance = found.x[1] / spread
        # The chi-squared of the plain law must fall as well: a term that gains nothing is no loss.
        if significance > _NEEDED and found.cost < (best[2].cost if best[1] else plain.cost):
            best = (law, significance, found)
    law, significance, found = best
    a = amplitude[0] / 2
    losses, row = np.zeros(3), np.zeros(len(found.x))
    losses[1], row[0] = found.x[0], 1.0
    if law != "proportional":
        losses[_TERMS[law]], row[1] = found.x[1], a ** (_TERMS[law] - 1)
    rate = float(row @ found.x)
    return law, significance, losses, Estimate(rate, math.sqrt(row @ found.covariance @ row))


@dataclass(frozen=True)
class _Losses:
    """Fitted losses (c1, then the other one), their covariance, and the chi-squared left."""

    x: np.ndarray
    covariance: np.ndarray
    cost: float


def _fit_losses(
    middle: np.ndarray, amplitude: np.ndarray, error: np.ndarray, terms: tuple[int, ...]
) -> _Losses:
    """Fits a_t = -(c1 a + c a^term) and the first amplitude; losses may not be negative."""
    t = middle - middle[0]
    span = max(t[-1], 1e-9)
    rate = max(math.log(amplitude[0] / amplitude[-1]) / span, 1e-3 / span)
    # Numbers of order one: a over its first value, losses over the mean rate.
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

    found = least_squares(residual, start, bounds=(0, np.inf))
    J = np.asarray(found.jac)
    scale = max(1.0, 2 * found.cost / max(len(t) - len(start), 1))
    covariance = np.linalg.pinv(J.T @ J)[1:, 1:] * scale
    units = np.array([rate, *(rate * amplitude[0] ** (1 - p) for p in terms)])
    return _Losses(found.x[1:] * units, covariance * np.outer(units, units), 2 * float(found.cost))


def _frequency_by_amplitude(
    middle: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, phase_error: np.ndarray, reference: float
) -> tuple[Estimate, Estimate]:
    """Frequency of small vibration [Hz], and its relative change per squared amplitude over the first.

    The phase against a sine of the reference frequency grows by 2 pi (f - f_ref); f = f0 (1 + s (a/a0)^2).
    """
    share = (amplitude / amplitude[0]) ** 2
    grown = np.concatenate([[0.0], np.cumsum(np.diff(middle) * (share[1:] + share[:-1]) / 2)])
    t = middle - middle[0]
    w = 1 / phase_error
    X = np.column_stack([np.ones(len(t)), 2 * math.pi * t, 2 * math.pi * grown])
    # A link that is not bent beyond use changes by percents: where the record cannot tell, that is what is known.
    prior = np.array([0.0, 0.0, 1 / (_SLOPE * reference)])
    solve = np.vstack([X * w[:, None], prior])
    x, *_ = np.linalg.lstsq(solve, np.r_[(phase - phase[0]) * w, 0.0], rcond=None)
    r = (phase - phase[0] - X @ x) * w
    scale = max(1.0, float(r @ r) / max(len(t) - 3, 1))
    errors = np.sqrt(np.diag(np.linalg.pinv(solve.T @ solve) * scale))
    small = reference + float(x[1])
    return Estimate(small, float(errors[1])), Estimate(float(x[2]) / small, float(errors[2]) / small)
