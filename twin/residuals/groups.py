"""Rows of the residual vector by recording and channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Group:
    """Rows of the residual vector that belong to one channel of one recording."""

    recording: int
    channel: str
    rows: slice


def split_into_blocks(groups: Sequence[Group], weight: np.ndarray, rows: int) -> tuple[Group, ...]:
    """The groups, each split into blocks of equal length.

    Args:
      groups: to split.
      weight: of each row (n); a block without any weight is joined to the one before it.
      rows: approximate length of a block.
    """
    blocks: list[Group] = []
    for group in groups:
        length = group.rows.stop - group.rows.start
        edges = np.linspace(group.rows.start, group.rows.stop, max(1, round(length / rows)) + 1).astype(int)
        pieces: list[Group] = []
        for first, last in zip(edges[:-1], edges[1:], strict=True):
            if pieces and not weight[first:last].any():
                pieces[-1] = Group(group.recording, group.channel, slice(pieces[-1].rows.start, int(last)))
            else:
                pieces.append(Group(group.recording, group.channel, slice(int(first), int(last))))
        blocks += pieces
    return tuple(blocks)
