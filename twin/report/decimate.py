"""Decimation of long series for plots, keeping every peak."""

from __future__ import annotations

import numpy as np

_SHORT = 1000.0  # s, of which the 24 bits of four bytes tell 0.06 ms


def as_axis(time: np.ndarray) -> np.ndarray:
    """Returns instants (n) [s] as few bytes; in full where they count from an epoch."""
    return time.astype("f4") if np.abs(time).max(initial=0.0) < _SHORT else time


def decimate(values: np.ndarray, points: int = 2000) -> np.ndarray:
    """Returns the indices of about `points` samples that look the same when plotted as a line.

    Of each interval its smallest and largest sample are kept, in order, and the first and last sample of all. An
    interval without a number keeps one NaN, so that the line breaks there.

    Args:
      values: (n) samples, NaN where one is missing.
      points: how many to keep.
    """
    n = len(values)
    if n <= points:
        return np.arange(n)
    size = -(-2 * n // points)
    padded = np.full(-(-n // size) * size, np.nan)
    padded[:n] = values
    stretches = padded.reshape(-1, size)
    start = size * np.arange(len(stretches))
    # NaN is neither smallest nor largest; where all are NaN, both are the first sample.
    low = start + np.argmin(np.where(np.isnan(stretches), np.inf, stretches), axis=1)
    high = start + np.argmax(np.where(np.isnan(stretches), -np.inf, stretches), axis=1)
    kept = np.unique(np.concatenate([low, high, [0, n - 1]]))
    return kept[kept < n]


def thin(count: int, points: int) -> np.ndarray:
    """Returns at most `points` evenly spaced indices of `count` samples, for scatter plots."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(points, count)).astype(int))
