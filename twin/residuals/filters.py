"""Zero-phase low-pass filter of signals on a uniform grid, and splines for their derivatives."""

from __future__ import annotations

import functools

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import butter, freqz, lfilter, lfilter_zi

BAND = 25.0
"""Cut-off of the low-pass [Hz]: above the second free mode of a rig like this, below the noise of its rates."""
GRID = 0.002
"""Step of the uniform grid on which signals are filtered [s]."""
REACH = 0.07
"""Span to either side of an instant from which the filter takes values [s]. Its impulse response decays as
exp(-pi BAND t), to 0.4 % there. At the end of a recording the filter continues the signal, so that this span is not
compared."""
STRIDE = 4
"""Of the instants of the grid, every so many are compared behind the low-pass: 125 a second tell as much as all 500.
Half that rate is 2.5 times `BAND`: what lies above and folds back has lost all but 0.4 % in the filter, and what folds
back into the band, from 100 Hz on, all but 0.02 %."""
SPLINE_DEGREE = 7
"""Of `smooth_spline`."""
MOTION_BANDS = (70.0, 45.0, 30.0, 20.0)
"""Cut-offs of the low-pass on the hub angle that drives the link, the widest first [Hz]. Large bends make harmonics of
the motion, which need a wide band, but a noisy sensor does not resolve them: see `make_view.motion_bands`."""


def low_passed(values: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Zero-phase low-pass of signals (..., m) on a uniform grid: Butterworth of order 3, forwards and backwards.

    The signal is continued by its odd extension at both ends, as by `scipy.signal.filtfilt`; the filter's steady state
    is cached here.

    Args:
      values: (..., m).
      period: step of the grid [s].
      band: cut-off of a single pass [Hz], at most 0.8 of the Nyquist frequency.
    """
    numerator, denominator, steady = _single_pass(min(band, 0.4 / period), period)
    pad = min(values.shape[-1] - 1, int(0.3 / period))
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : -pad - 2 : -1]
    signal = np.concatenate([before, values, behind], axis=-1)
    for _ in range(2):
        signal, _ = lfilter(numerator, denominator, signal, zi=steady * signal[..., :1])
        signal = signal[..., ::-1]
    return signal[..., pad : signal.shape[-1] - pad]


@functools.lru_cache
def _single_pass(cutoff: float, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numerator and denominator of the Butterworth filter, and its state in the steady state of a unit step."""
    numerator, denominator = butter(3, cutoff, fs=1 / period)
    return numerator, denominator, lfilter_zi(numerator, denominator)


def low_pass_gain(frequency: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Gain of `low_passed` at frequencies [Hz]: the squared magnitude response of the single pass."""
    numerator, denominator, _ = _single_pass(min(band, 0.4 / period), period)
    return np.abs(freqz(numerator, denominator, frequency, fs=1 / period)[1]) ** 2


def smooth_spline(time: np.ndarray, values: np.ndarray) -> BSpline:
    """Interpolating spline through samples (m) of a band-limited signal, of a degree that suits its second derivative.

    The second derivative of a cubic spline is too large by (omega h)^2/12, at 18 Hz and h = 2 ms by 0.4 %.
    """
    return make_interp_spline(time, values, k=min(SPLINE_DEGREE, len(time) - 1 - len(time) % 2))
