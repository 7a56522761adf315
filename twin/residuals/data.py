"""The recordings seen locally in time: the link driven by the measured hub, and the balance of the hub.

A free-running simulation is decided by every stick and slip. Here the measured hub angle moves the link instead:
its strains follow without friction, and the torque that the motion takes is known at every instant. What the
strains leave is missing in the link or a sensor; what drive, friction and that torque leave is missing at the hub.

All signals pass the same zero-phase low-pass, so that measured and simulated ones stay comparable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.mechanics.state import Start
from twin.residuals.filters import BAND, GRID, MOTION_BANDS
from twin.residuals.groups import Group, stretches
from twin.residuals.make_view import look
from twin.residuals.prepared import Prepared
from twin.residuals.residual import residual
from twin.residuals.view import LEFT_OUT, before_end
from twin.rigs.model import Model

BLOCK = 1.5
"""Length of the stretches over each of which the size of the misfit is taken as one [s]."""
SINGLE = ("break_away", "departure")
"""Channels of instants that are independent of one another; the filter makes those of the others alike."""
_SETTLING = 0.5  # s left out at the start of a rig that was already moving


class DrivenData:
    """The views of some recordings as residuals for a fit."""

    def __init__(self, prepared: Sequence[Prepared], model: Model, bands: Sequence[float] = MOTION_BANDS):
        self.prepared = tuple(prepared)
        self.views = tuple(look(p, model, bands) for p in self.prepared)
        self.groups, self.weight = self._layout()
        self.blocks = stretches(self.groups, self.weight, int(BLOCK / GRID))

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """See `residual`."""
        return residual(self.views[i], self.prepared[i], model, start)

    def counts(self) -> np.ndarray:
        """Number of independent samples of each block (g): the filter leaves two a hertz and second."""
        per_sample = min(1.0, 2 * BAND * GRID)
        return np.array(
            [self.weight[g.rows].sum() * (1.0 if g.channel in SINGLE else per_sample) for g in self.blocks]
        )

    def _layout(self) -> tuple[tuple[Group, ...], np.ndarray]:
        groups, weights, row = [], [], 0
        for i, (view, p) in enumerate(zip(self.views, self.prepared, strict=True)):
            late = view.time >= view.time[0] + (_SETTLING if p.recording.start == "unknown" else 0.0)
            if p.hub is not None:
                late &= before_end(view.time, LEFT_OUT)
            named = {c: view.known[c] & late for c in view.measured}
            if p.hub is not None:
                named["hub_torque"] = view.sliding & late
            # What a link rings with since its first state was estimated is too much for what is told by an instant.
            if p.hub is not None and p.recording.start == "rest":
                at_onset = np.zeros(len(view.time), dtype=bool)
                at_onset[[k for k, _ in view.onsets if 0 < k < len(at_onset)]] = True
                named["break_away"] = at_onset
                named["departure"] = view.departing & late
            for channel, mask in named.items():
                if mask.any() and np.isfinite(list(view.noise.values())).all():
                    groups.append(Group(i, channel, slice(row, row + len(mask))))
                    weights.append(mask.astype(float))
                    row += len(mask)
        return tuple(groups), np.concatenate(weights) if weights else np.zeros(0)
