"""Data to fit to, and the simulations that a fit needs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from typing import Protocol

import numpy as np

from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.mechanics.state import Start
from twin.recording import HUB_TORQUE, Recording
from twin.residuals import hub_balance
from twin.residuals.data import DrivenData
from twin.residuals.groups import Group
from twin.residuals.prepared import Prepared, guided, reading_start
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

MEMORY = 0.25
"""Span over which a change of the hub angle is compared [s]."""
CORRELATION = 0.05
"""Span over which a misfit is taken as one piece of evidence while fitting [s]."""


class Data(Protocol):
    """Recordings as residuals: which groups there are, and how a model does on one recording."""

    prepared: tuple[Prepared, ...]
    groups: tuple[Group, ...]
    blocks: tuple[Group, ...]
    weight: np.ndarray

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> residual (m) of recording i in noise units, 0 where unknown."""

    def counts(self) -> np.ndarray:
        """Number of pieces of evidence in each block (g)."""


class Workbench:
    """Data to fit to, and the simulations that a fit needs, side by side on the processors."""

    def __init__(self, data: Data, pool: ThreadPoolExecutor):
        self.data = data
        self.pool = pool
        self.prepared, self.groups, self.weight = data.prepared, data.blocks, data.weight
        self.count = data.counts()
        self.defect = np.zeros(len(self.weight))

    def channels(self) -> set[str]:
        """Channels that are compared in any recording."""
        return {c for p in self.prepared for c in p.channels}

    def without(self, channels: Collection[str]) -> Workbench:
        """The same, but what these channels say counts for nothing."""
        bench = copy(self)
        bench.count = np.where([g.channel in channels for g in self.groups], 0.0, self.count)
        return bench

    def with_defect(self, defect: np.ndarray) -> Workbench:
        """The same, but with `defect` (n), in noise units, taken out of every residual."""
        bench = copy(self)
        bench.defect = defect
        return bench

    def residuals(self, jobs: Sequence[tuple[Model, Sequence[Start], int | None]]) -> list[np.ndarray]:
        """Measured minus simulated in noise units (n) of each (model, starts, only recording or None).

        A job for one recording has zeros elsewhere.
        """
        tasks = [
            (index, i, model, starts[i])
            for index, (model, starts, only) in enumerate(jobs)
            for i in range(len(self.prepared))
            if only is None or only == i
        ]
        # The longest first, so that no processor waits for it at the end.
        tasks.sort(key=lambda task: -self.prepared[task[1]].recording.duration)
        results = [np.zeros(len(self.weight)) for _ in jobs]
        for (index, i, _, _), parts in zip(tasks, self.pool.map(self._task, tasks), strict=True):
            for group in self.data.groups:
                if group.recording == i:
                    rows = group.rows
                    part = np.clip(np.nan_to_num(parts[group.channel], nan=1e6), -1e6, 1e6)
                    results[index][rows] = (part - self.defect[rows]) * self.weight[rows]
        return results

    def _task(self, task: tuple[int, int, Model, Start]) -> dict[str, np.ndarray]:
        _, i, model, start = task
        return self.data.residual(model, i, start)

    def sizes(self, residual: np.ndarray) -> np.ndarray:
        """Root-mean-square of each group (g), noise units."""
        return loss.group_sizes(residual, self.groups, self.weight)

    def cost(self, residual: np.ndarray) -> float:
        """What a residual (n) costs, priors apart."""
        return float(self.count @ loss.loss(self.sizes(residual)))

    def misfit(self, residual: np.ndarray) -> float:
        """What a residual (n) costs above pure noise."""
        return float(self.count @ np.maximum(loss.loss(self.sizes(residual)) - 0.5, 0.0))


class GuidedData:
    """Recordings beside guided free-running simulations."""

    def __init__(self, prepared: Sequence[Prepared]):
        self.prepared = tuple(prepared)
        self.groups, self.weight = _layout(self.prepared)
        self.blocks = self.groups

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """See `whitened`."""
        return whitened(model, self.prepared[i], start)

    def counts(self) -> np.ndarray:
        """Number of pieces of evidence in each group (g), if its misfit is correlated."""
        spans = [self.prepared[g.recording].recording.duration for g in self.groups]
        known = [self.weight[g.rows].mean() for g in self.groups]
        return np.array(spans) * np.array(known) / CORRELATION


class FreeData(GuidedData):
    """Recordings beside simulations that only their first samples and their command lead."""

    def counts(self) -> np.ndarray:
        """As of guided ones, but 0 where the rig was already moving: what leads there is not known well enough."""
        begun = [self.prepared[g.recording].recording.start == "unknown" for g in self.groups]
        return np.where(begun, 0.0, super().counts())

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> measured minus simulated in noise units (m), 0 where missing."""
        prepared = self.prepared[i]
        measured = prepared.recording
        predicted = simulate(model, measured, reading_start(model, prepared, start))
        return {c: (measured[c] - predicted[c]) / prepared.noise[c] for c in prepared.channels}


def whitened(model: Model, prepared: Prepared, start: Start) -> dict[str, np.ndarray]:
    """Channel -> measured minus simulated in noise units (m), 0 where missing; the simulation guided."""
    measured = prepared.recording
    start = reading_start(model, prepared, start)
    predicted = simulate(model, measured, start, guided(model, prepared, tight=False))
    return {
        c: _local(c, (measured[c] - predicted[c]) / prepared.noise[c], measured.time)
        for c in prepared.channels
    }


def _local(channel: str, residual: np.ndarray, time: np.ndarray) -> np.ndarray:
    """A residual (m) local in time, 0 where it is unknown.

    Nothing holds a sliding hub in place, so that the smallest torque adds up to a drift without end: of the hub
    angle, the change over `MEMORY` counts, with the noise of one reading.
    """
    if channel == "hub_angle":
        earlier = np.maximum(np.searchsorted(time, time - MEMORY + 1e-9), 0)
        first = time < time[0] + MEMORY
        residual = np.where(first, residual, (residual - residual[earlier]) / np.sqrt(2))
    return np.clip(np.nan_to_num(residual, nan=0.0), -1e6, 1e6)


def _layout(prepared: Sequence[Prepared]) -> tuple[tuple[Group, ...], np.ndarray]:
    groups, weights, row = [], [], 0
    for i, p in enumerate(prepared):
        for channel in p.channels:
            known = np.isfinite(_known(channel, p.recording))
            groups.append(Group(i, channel, slice(row, row + len(known))))
            weights.append(known.astype(float))
            row += len(known)
    return tuple(groups), np.concatenate(weights) if weights else np.zeros(0)


def _known(channel: str, recording: Recording) -> np.ndarray:
    blank = np.where(np.isfinite(recording[channel]), 1.0, np.nan)
    if channel != "hub_angle":
        return blank
    time = recording.time
    return blank + np.where(time < time[0] + MEMORY, 0.0, blank[np.searchsorted(time, time - MEMORY + 1e-9)])


def known_weights(bench: Workbench, fit: Fit) -> np.ndarray:
    """1 where a torque can be told in time, 0 about fast reversals under a sliding friction that falls with speed (n).

    There it jumps by twice the break-away torque within milliseconds: when the measured hub turns round is not known
    so well, and the filter spreads the jump.
    """
    told = np.ones(len(fit.residual))
    if not fit.model.plant.friction.stribeck_velocity > 0:
        return told
    for group in bench.data.groups:
        if group.channel == HUB_TORQUE and isinstance(bench.data, DrivenData):
            told[group.rows] = ~hub_balance.near_reversals(bench.data.views[group.recording])
    return told
