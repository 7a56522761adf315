"""How much one model is to be preferred to another, where neither need be right.

Residuals are grouped by recording and channel. Where a model is right a group is sensor noise. Where it is wrong
the misfit is larger than the noise, and its size is estimated with the rest (profile likelihood, -n log s for a
group of root-mean-square s in noise units); n is the number of independent samples that the data say they have.
A model is seldom wrong everywhere: the sizes are those of stretches of a second or two, so that a resonance that
bends the link too far for it does not take the rest of a recording's word away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Group:
    """Residuals of one channel of one recording: where they stand in the residual vector."""

    recording: int
    channel: str
    rows: slice


def group_sizes(residual: np.ndarray, groups: Sequence[Group], weight: np.ndarray) -> np.ndarray:
    """Root-mean-square of each group (g) in noise units; `weight` (n) is 0 where a sample is missing.

    The groups follow one another without a gap.
    """
    starts = [g.rows.start for g in groups]
    squares = np.add.reduceat(residual**2 * weight, starts)
    return np.sqrt(squares / np.maximum(np.add.reduceat(weight, starts), 1))


def stretches(groups: Sequence[Group], weight: np.ndarray, rows: int) -> tuple[Group, ...]:
    """The groups cut into stretches of about so many rows, those without any sample joined to the one before."""
    found: list[Group] = []
    for group in groups:
        length = group.rows.stop - group.rows.start
        edges = np.linspace(group.rows.start, group.rows.stop, max(1, round(length / rows)) + 1).astype(int)
        pieces: list[Group] = []
        for first, last in zip(edges[:-1], edges[1:], strict=True):
            if pieces and not weight[first:last].any():
                pieces[-1] = Group(group.recording, group.channel, slice(pieces[-1].rows.start, int(last)))
            else:
                pieces.append(Group(group.recording, group.channel, slice(int(first), int(last))))
        found += pieces
    return tuple(found)


def loss(size: np.ndarray) -> np.ndarray:
    """Negative log likelihood per sample of groups of this size (g), noise units.

    s^2/2 up to the noise; log s beyond it, where the misfit's own size is the better guess.
    """
    return np.where(size < 1, 0.5 * size**2, 0.5 + np.log(np.maximum(size, 1.0)))
