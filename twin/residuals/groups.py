"""Where the residuals of each channel of each recording stand in the residual vector."""

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
