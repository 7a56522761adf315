"""Negative log likelihood of residuals whose size is a nuisance parameter.

Residuals are grouped by recording, channel and stretch of time. Where a model is right, the residual of a group is
sensor noise of unit size. Where it is wrong, the residual is larger and its size s is estimated with the other
parameters, which gives the profile likelihood s^-n for a group of root mean square s; n is the number of independent
samples in the group. The stretches are a second or two long, because a model is seldom wrong everywhere: a resonance
that bends the link beyond the model's validity then does not reduce the weight of the rest of its recording.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.residuals.groups import Group


def group_sizes(residual: np.ndarray, groups: Sequence[Group], weight: np.ndarray) -> np.ndarray:
    """Root mean square of each group (g), in multiples of the noise.

    Args:
      residual: (n) in multiples of the noise.
      groups: adjacent ranges of rows that cover the residual without a gap.
      weight: (n) 0 where a sample is missing, otherwise 1.
    """
    starts = [g.rows.start for g in groups]
    squares = np.add.reduceat(residual**2 * weight, starts)
    return np.sqrt(squares / np.maximum(np.add.reduceat(weight, starts), 1))


def loss(size: np.ndarray) -> np.ndarray:
    """Negative log likelihood per sample (g), up to a constant, of groups with these root mean squares (g).

    s^2/2 up to the noise level, 1/2 + log s above it: a profile likelihood in which a group is never quieter than its
    sensor noise. Value and slope are continuous at s = 1.
    """
    return np.where(size < 1, 0.5 * size**2, 0.5 + np.log(np.maximum(size, 1.0)))


ADEQUATE_RMS = 1.4
"""Root mean square, in multiples of the noise, below which the residuals of a right model lie, on recordings with
defects too."""
