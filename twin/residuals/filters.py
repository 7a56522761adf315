"""Zero-phase low-pass of signals on a uniform grid, and their derivatives."""

from __future__ import annotations

import functools

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import butter, sosfilt, sosfilt_zi, sosfreqz

BAND = 25.0
"""Corner of the low-pass [Hz]: above the second free mode of a rig like this, below the noise of its rates."""
GRID = 0.002  # s, uniform grid on which the signals are filtered
REACH = 0.07
"""Reach of the filter about an instant [s]."""
MOTION_BANDS = (70.0, 45.0, 30.0, 20.0)
"""Corners of the low-pass on the motion that drives the link [Hz]: large bends make harmonics of it, but a poor
sensor cannot tell them; the widest is taken in which strong accelerations stand out of their noise."""


def low_passed(values: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Zero-phase low-pass of a signal (m), or of several (..., m), on a uniform grid.

    Forwards and backwards from an odd extension, as `scipy.signal.sosfiltfilt`, whose states at rest are kept here.
    """
    sections, resting = _sections(min(band, 0.4 / period), period)
    pad = min(values.shape[-1] - 1, int(0.3 / period))
    resting = resting.reshape(len(sections), *(1,) * (values.ndim - 1), 2)
    before = 2 * values[..., :1] - values[..., pad:0:-1]
    behind = 2 * values[..., -1:] - values[..., -2 : -pad - 2 : -1]
    signal = np.concatenate([before, values, behind], axis=-1)
    for _ in range(2):
        signal, _ = sosfilt(sections, signal, zi=resting * signal[..., :1])
        signal = signal[..., ::-1]
    return signal[..., pad : signal.shape[-1] - pad]


@functools.lru_cache
def _sections(corner: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    sections = butter(3, corner, fs=1 / period, output="sos")
    return sections, sosfilt_zi(sections)


def passed(frequency: np.ndarray, period: float, band: float = BAND) -> np.ndarray:
    """Share of a sine of this frequency [Hz] that `low_passed` leaves."""
    sections, _ = _sections(min(band, 0.4 / period), period)
    return np.abs(sosfreqz(sections, frequency, fs=1 / period)[1]) ** 2


def smooth(time: np.ndarray, values: np.ndarray) -> BSpline:
    """A spline through samples (m) of a band-limited signal whose second derivative can be relied on.

    That of a cubic one is too large by (omega h)^2/12, at 18 Hz and h = 2 ms by 0.4 %.
    """
    return make_interp_spline(time, values, k=min(7, len(time) - 1 - len(time) % 2))
