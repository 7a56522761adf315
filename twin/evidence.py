"""How much one model is to be preferred to another, where neither need be right.

Residuals are grouped by recording and channel. Where a model is right a group is sensor noise. Where it is wrong
the misfit is larger than the noise, and its size is estimated with the rest (profile likelihood, -n log s for a
group of root-mean-square s in noise units); n is the number of independent samples that the data say they have.
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


def loss(size: np.ndarray) -> np.ndarray:
    """Negative log likelihood per sample of groups of this size (g), noise units.

    s^2/2 up to the noise; log s beyond it, where the misfit's own size is the better guess.
    """
    return np.where(size < 1, 0.5 * size**2, 0.5 + np.log(np.maximum(size, 1.0)))
