"""How much one model is to be preferred to another, where neither need be right.

Residuals are grouped by recording and channel. Where a model is right a group is white sensor noise and its
n samples count in full. Where it is wrong the misfit is larger than the noise and correlated: its size is then
estimated with the rest (profile likelihood, -n log s for a group of root-mean-square s in noise units), and n is
replaced by the number of samples that are independent, n over the integral autocorrelation time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Group:
    """Residuals of one channel of one recording: where they stand in the residual vector."""

    recording: int
    channel: str
    rows: slice


def sizes(residual: np.ndarray, groups: tuple[Group, ...], weight: np.ndarray) -> np.ndarray:
    """Root-mean-square of each group (g) in noise units; `weight` (n) is 0 where a sample is missing."""
    squares = residual**2 * weight
    return np.array([np.sqrt(squares[g.rows].sum() / max(weight[g.rows].sum(), 1)) for g in groups])


def independent(residual: np.ndarray, groups: tuple[Group, ...], weight: np.ndarray) -> np.ndarray:
    """Number of independent samples in each group (g)."""
    return np.array([weight[g.rows].sum() / correlation_time(residual[g.rows]) for g in groups])


def correlation_time(series: np.ndarray) -> float:
    """Integral autocorrelation time of a series (n), in samples: 1 for white noise.

    Summed over a self-consistent window of five times itself (A. Sokal, "Monte Carlo Methods in Statistical
    Mechanics", 1996, section 3).
    """
    n = len(series)
    spectrum = np.fft.rfft(series, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    if not correlation[0] > 0:
        return 1.0
    times = 2 * np.cumsum(correlation / correlation[0]) - 1
    beyond = np.arange(n) >= 5 * times
    window = int(np.argmax(beyond)) if beyond.any() else n - 1
    return float(max(1.0, times[window]))


def loss(size: np.ndarray) -> np.ndarray:
    """Negative log likelihood per sample of groups of this size (g), noise units.

    s^2/2 up to the noise; log s beyond it, where the misfit's own size is the better guess.
    """
    return np.where(size < 1, 0.5 * size**2, 0.5 + np.log(np.maximum(size, 1.0)))
