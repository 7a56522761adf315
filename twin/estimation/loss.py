"""How much one model is to be preferred to another, where neither need be right.

Residuals are grouped by recording and channel. Where a model is right a group is sensor noise. Where it is wrong
the misfit is larger than the noise, and its size is estimated with the rest (profile likelihood, -n log s for a
group of root-mean-square s in noise units); n is the number of independent samples that the data say they have.
A model is seldom wrong everywhere: the sizes are those of stretches of a second or two, so that a resonance that
bends the link too far for it does not take the rest of a recording's word away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.residuals.groups import Group


def group_sizes(residual: np.ndarray, groups: Sequence[Group], weight: np.ndarray) -> np.ndarray:
    """Root-mean-square of each group (g) in noise units; `weight` (n) is 0 where a sample is missing.

    The groups follow one another without a gap.
    """
    starts = [g.rows.start for g in groups]
    squares = np.add.reduceat(residual**2 * weight, starts)
    return np.sqrt(squares / np.maximum(np.add.reduceat(weight, starts), 1))


def loss(size: np.ndarray) -> np.ndarray:
    """Negative log likelihood per sample of groups of this size (g), noise units.

    s^2/2 up to the noise; log s beyond it, where the misfit's own size is the better guess.
    """
    return np.where(size < 1, 0.5 * size**2, 0.5 + np.log(np.maximum(size, 1.0)))


SOUND = 1.4
"""Noise levels up to which residuals of a right model lie, on dirty recordings too."""
