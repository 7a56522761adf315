"""Rows of the residual vector by recording and channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Group:
    """Rows of the residual vector that belong to one channel of one recording, or a block of these.

    Attributes:
      recording: index of the recording.
      channel: name of the channel.
      rows: in the residual vector.
      instants: (r) indices of the rows on the grid of the recording, ascending; every one by default.
      stretch: of a block, which of the equal stretches of the recording it begins in.
    """

    recording: int
    channel: str
    rows: slice
    instants: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int), repr=False, compare=False)
    stretch: int = 0

    def __post_init__(self) -> None:
        if not len(self.instants):
            object.__setattr__(self, "instants", np.arange(self.rows.stop - self.rows.start))


def split_into_blocks(
    groups: Sequence[Group], weight: np.ndarray, counts: Sequence[int], span: int
) -> tuple[Group, ...]:
    """The groups, each split into blocks of equal length in time.

    Args:
      groups: to split.
      weight: of each row (n); a block without any weight is joined to the one before it.
      counts: number of instants on the grid of each recording.
      span: approximate number of instants in a block.
    """
    blocks: list[Group] = []
    for group in groups:
        count = counts[group.recording]
        edges = np.linspace(0, count, max(1, round(count / span)) + 1).astype(int)
        blocks += _blocks(group, weight[group.rows], np.searchsorted(group.instants, edges))
    return tuple(blocks)


def _blocks(group: Group, weight: np.ndarray, edges: np.ndarray) -> list[Group]:
    """The blocks of a group with weights (r) between edges, which count its rows."""
    pieces: list[tuple[int, int, int]] = []
    for stretch, (first, last) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        if pieces and not weight[first:last].any():
            begin, _, of_first = pieces[-1]
            pieces[-1] = begin, last, of_first
        elif first < last:
            pieces.append((first, last, stretch))
    start = group.rows.start
    return [
        Group(group.recording, group.channel, slice(start + a, start + b), group.instants[a:b], stretch)
        for a, b, stretch in pieces
    ]
