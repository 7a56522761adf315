"""Recordings as residuals that are local in time: the link driven by the measured hub, and the hub's torque balance.

A free-running simulation depends on every stick and slip. Here the measured hub angle drives the modelled link: its
strains then do not depend on friction, and the torque on the hub that the motion requires is known at every instant.
Residuals of the strains are due to the link or the sensors; a residual of the torque balance is due to the hub.

All signals pass the same zero-phase low-pass, so that measured and simulated ones remain comparable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.mechanics.state import Start
from twin.residuals.filters import BAND, GRID, MOTION_BANDS, REACH, STRIDE
from twin.residuals.groups import Group, split_into_blocks
from twin.residuals.make_view import make_view
from twin.residuals.prepared import Prepared
from twin.residuals.residual import EVENT_CHANNELS, residual
from twin.residuals.view import SETTLING, View, before_end
from twin.rigs.model import Model

BLOCK_SPAN = 1.5
"""Length of the blocks in each of which the size of the residual is estimated [s]."""


class DrivenData:
    """Residuals of recordings whose measured hub drives the modelled link; n rows in all.

    Attributes:
      prepared: the recordings.
      views: their signals on the grid, with the noise of the residuals.
      groups: rows of each residual of each recording; none of recordings under which the link diverges. Of residuals
        behind the low-pass every `STRIDE`th instant has a row, of those at single instants each of these.
      weight: 1 where there is a residual, otherwise 0 (n).
      blocks: the groups, cut into stretches of `BLOCK_SPAN` (g).
    """

    def __init__(self, prepared: Sequence[Prepared], views: Sequence[View]):
        self.prepared, self.views = tuple(prepared), tuple(views)
        self.groups, self.weight = self._layout()
        counts = [len(view.time) for view in self.views]
        self.blocks = split_into_blocks(self.groups, self.weight, counts, int(BLOCK_SPAN / GRID))

    @staticmethod
    def of(prepared: Sequence[Prepared], model: Model, bands: Sequence[float] = MOTION_BANDS) -> DrivenData:
        """The data of recordings, their noise propagated through a model, see `make_view.make_view`."""
        return DrivenData(prepared, [make_view(p, model, bands) for p in prepared])

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Name -> residual (r) of recording i at the instants of its rows, see `residual.residual`."""
        parts = residual(self.views[i], self.prepared[i], model, start)
        return {
            g.channel: parts[g.channel][g.instants] if g.channel in EVENT_CHANNELS else parts[g.channel]
            for g in self.groups
            if g.recording == i
        }

    def row_period(self, i: int) -> float:
        """Time between two rows of recording i that are not single instants [s]."""
        return STRIDE * GRID

    def counts(self) -> np.ndarray:
        """Number of independent samples in each block (g): twice the bandwidth of the filter per second.

        There are no more than readings.
        """
        return np.array(
            [
                self.weight[g.rows].sum()
                * (1.0 if g.channel in EVENT_CHANNELS else self._independent(g.recording))
                for g in self.blocks
            ]
        )

    def _independent(self, i: int) -> float:
        """Independent samples of recording i in each row behind the low-pass."""
        return STRIDE * GRID * min(2 * BAND, 1 / self.prepared[i].recording.period)

    def _layout(self) -> tuple[tuple[Group, ...], np.ndarray]:
        """Rows of each residual of each recording, and the weights (n): 1 where there is a residual, else 0.

        A recording under whose motion the modelled link diverges has no rows.
        """
        groups, weights, row = [], [], 0
        for i, (view, p) in enumerate(zip(self.views, self.prepared, strict=True)):
            compared = view.time >= view.time[0] + (SETTLING if p.recording.start == "unknown" else 0.0)
            if p.hub is not None:
                compared &= before_end(view.time, REACH)
            masks = {c: view.known[c] & compared for c in view.measured}
            if p.hub is not None:
                masks["hub_torque"] = view.sliding & compared
            # With an estimated initial state, the link oscillates too much for residuals at single instants.
            if p.hub is not None and p.recording.start == "rest":
                at_onset = np.zeros(len(view.time), dtype=bool)
                at_onset[[k for k, _ in view.onsets if 0 < k < len(at_onset)]] = True
                masks["break_away"] = at_onset
                masks["departure"] = view.departing & compared
            for channel, mask in masks.items():
                if mask.any() and np.isfinite(list(view.noise.values())).all():
                    single = channel in EVENT_CHANNELS
                    instants = np.flatnonzero(mask) if single else np.arange(0, len(mask), STRIDE)
                    groups.append(Group(i, channel, slice(row, row + len(instants)), instants))
                    weights.append(mask[instants].astype(float))
                    row += len(instants)
        return tuple(groups), np.concatenate(weights) if weights else np.zeros(0)
