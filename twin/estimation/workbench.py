"""Data of a fit, in three forms of residual, and the parallel simulations that a fit needs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from copy import copy
from typing import Protocol

import numpy as np

from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualData, ResidualPool
from twin.mechanics.state import Start
from twin.recording import HUB_TORQUE, Recording
from twin.residuals import hub_balance
from twin.residuals.data import DrivenData
from twin.residuals.filters import MOTION_BANDS
from twin.residuals.groups import Group
from twin.residuals.make_view import make_view
from twin.residuals.numerics import ROUNDING
from twin.residuals.prepared import Prepared, guide_for, sensor_corrected_start
from twin.residuals.view import View
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

CHANGE_SPAN = 0.25
"""Span over which the change of the hub angle is compared in a guided simulation [s]."""
CORRELATION_TIME = 0.05
"""Time over which the misfit of a guided or free simulation is correlated: one independent sample [s]."""
DIVERGED = 1e6
"""Residual of a simulation that is no longer finite [noise levels]."""


def finite(residual: np.ndarray) -> np.ndarray:
    """A residual of any shape [noise levels], at most `DIVERGED`, and that where it is no number."""
    return np.clip(np.nan_to_num(residual, nan=DIVERGED), -DIVERGED, DIVERGED)


def driven_data(
    prepared: Sequence[Prepared], model: Model, pool: ResidualPool, bands: Sequence[float] = MOTION_BANDS
) -> DrivenData:
    """`DrivenData.of`, its views made side by side."""
    given = [(p, model, bands) for p in prepared]
    return DrivenData(prepared, pool.spread(_view_of, given, [p.recording.duration for p in prepared]))


def _view_of(given: tuple[Prepared, Model, Sequence[float]], _: ResidualPool) -> View:
    return make_view(*given)


class Data(ResidualData, Protocol):
    """Recordings as residuals; n rows in all.

    Attributes:
      groups: rows of each channel of each recording.
      blocks: the groups, cut into stretches of time whose size is estimated (g).
      weight: (n) 1 where a sample is compared, otherwise 0.
    """

    groups: tuple[Group, ...]
    blocks: tuple[Group, ...]
    weight: np.ndarray

    def counts(self) -> np.ndarray:
        """Number of independent samples in each block (g)."""

    def row_period(self, i: int) -> float:
        """Time between two rows of recording i that are not single instants [s]."""


class Workbench:
    """Data of a fit and the pool in which their residuals are computed; n residuals, g blocks.

    Attributes:
      data: the recordings as residuals.
      pool: where residuals are computed.
      prepared: the recordings.
      groups: the blocks of the data (g).
      weight: (n) 1 where a sample is compared, otherwise 0.
      count: number of independent samples in each block (g).
      defect: discretisation error of the residual that is subtracted (n), in multiples of the noise.
      deviation: (n) of noise and of what remains of that error together, in multiples of the noise; 1 where unknown.
      scale: (n) weight over deviation: from an error in multiples of the noise to a residual.
    """

    def __init__(self, data: Data, pool: ResidualPool):
        self.data = data
        self.pool = pool
        self.prepared, self.groups, self.weight = data.prepared, data.blocks, data.weight
        self.count = data.counts()
        self.defect, self.deviation = np.zeros(len(self.weight)), np.ones(len(self.weight))
        self.scale = self.weight

    def channels(self) -> set[str]:
        """Channels that are compared in any recording."""
        return {c for p in self.prepared for c in p.channels}

    def without_channels(self, channels: Collection[str]) -> Workbench:
        """A workbench in which these channels have no weight."""
        bench = copy(self)
        bench.count = np.where([g.channel in channels for g in self.groups], 0.0, self.count)
        return bench

    def with_defect(self, defect: np.ndarray) -> Workbench:
        """A workbench that subtracts `defect` (n), in multiples of the noise, from every residual."""
        bench = copy(self)
        bench.defect = defect
        return bench

    def with_remaining_error(self, error: np.ndarray) -> Workbench:
        """A workbench for whose residuals an error counts as noise, beside that of the sensors.

        Args:
          error: (n) estimate, in multiples of the noise; its root mean square in each block is what counts.
        """
        bench = copy(self)
        size = loss.group_sizes(error, self.groups, self.weight)
        bench.deviation = np.hypot(1.0, np.repeat(size, [g.rows.stop - g.rows.start for g in self.groups]))
        bench.scale = bench.weight / bench.deviation
        return bench

    def residuals(self, jobs: Sequence[tuple[Model, Sequence[Start], int | None]]) -> list[np.ndarray]:
        """Measured minus simulated (n), in multiples of the noise and of what counts as noise, of each job.

        Args:
          jobs: model, initial state of each recording, and index of the only recording to simulate, or None for all.
            Rows of recordings that are not simulated are zero.
        """
        tasks = [
            (index, (i, model, starts[i]))
            for index, (model, starts, only) in enumerate(jobs)
            for i in range(len(self.prepared))
            if only is None or only == i
        ]
        results = [np.zeros(len(self.weight)) for _ in jobs]
        computed = self.pool.residuals(self.data, [task for _, task in tasks])
        for (index, (i, _, _)), parts in zip(tasks, computed, strict=True):
            for group in self.data.groups:
                if group.recording == i:
                    rows = group.rows
                    part = finite(parts[group.channel])
                    results[index][rows] = (part - self.defect[rows]) * self.scale[rows]
        return results

    def sizes(self, residual: np.ndarray) -> np.ndarray:
        """Root mean square of a residual (n) in each block (g), in multiples of the noise."""
        return loss.group_sizes(residual, self.groups, self.weight)

    def cost(self, residual: np.ndarray) -> float:
        """Negative log likelihood of a residual (n), up to a constant, without priors."""
        return float(self.count @ loss.loss(self.sizes(residual)))

    def misfit(self, residual: np.ndarray) -> float:
        """By how much the negative log likelihood of a residual (n) exceeds that of sensor noise alone."""
        return float(self.misfits(residual).sum())

    def misfits(self, residual: np.ndarray) -> np.ndarray:
        """The misfit of a residual (n) in each block (g)."""
        return self.count * np.maximum(loss.loss(self.sizes(residual)) - 0.5, 0.0)

    def by_recording(self, of_blocks: np.ndarray) -> np.ndarray:
        """Sum of a quantity of each block (g) over the blocks of each recording."""
        total = np.zeros(len(self.prepared))
        np.add.at(total, [g.recording for g in self.groups], of_blocks)
        return total

    def penalty(self, parameters: int) -> float:
        """Penalty of this number of parameters: each half the log of the number of samples (Schwarz, 1978) [nat]."""
        return 0.5 * parameters * float(np.log(max(self.count.sum(), 2.0)))


class GuidedData:
    """Residuals of guided simulations: the hub sticks and slides when the measured hub does."""

    def __init__(self, prepared: Sequence[Prepared]):
        self.prepared = tuple(prepared)
        self.groups, self.weight = layout(self.prepared, _comparable)
        self.blocks = self.groups

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """See `guided_residual`."""
        return guided_residual(model, self.prepared[i], start)

    def row_period(self, i: int) -> float:
        """Time between two samples of recording i [s]."""
        return self.prepared[i].recording.period

    def counts(self) -> np.ndarray:
        """Number of independent samples in each group (g): one per `CORRELATION_TIME`, no more than readings."""
        recordings = [self.prepared[g.recording].recording for g in self.groups]
        spans = [r.duration / max(CORRELATION_TIME, r.period) for r in recordings]
        known = [self.weight[g.rows].mean() for g in self.groups]
        return np.array(spans) * np.array(known)


class FreeData(GuidedData):
    """Residuals of free-running simulations, which know the initial state and the command alone."""

    def counts(self) -> np.ndarray:
        """As of guided data, but 0 for rigs that were moving at the first sample: their state is too uncertain."""
        moving = [self.prepared[g.recording].recording.start == "unknown" for g in self.groups]
        return np.where(moving, 0.0, super().counts())

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> measured minus simulated (m), in multiples of the noise, not a number where missing."""
        prepared = self.prepared[i]
        measured = prepared.recording
        predicted = simulate(model, measured, sensor_corrected_start(model, prepared, start))
        return {c: (measured[c] - predicted[c]) / prepared.noise[c] for c in prepared.channels}


def guided_residual(model: Model, prepared: Prepared, start: Start) -> dict[str, np.ndarray]:
    """Channel -> measured minus simulated (m), in multiples of the noise, 0 where missing; the simulation is guided.

    Of the hub angle, the change over `CHANGE_SPAN` is compared.
    """
    measured = prepared.recording
    start = sensor_corrected_start(model, prepared, start)
    predicted = simulate(model, measured, start, guide_for(model, prepared, tight=False))
    return {
        c: _local(c, (measured[c] - predicted[c]) / prepared.noise[c], measured.time)
        for c in prepared.channels
    }


def _local(channel: str, residual: np.ndarray, time: np.ndarray) -> np.ndarray:
    """A residual (m) that is local in time, 0 where it is unknown.

    Nothing holds a sliding hub in place, so that the smallest torque error adds up to an unlimited drift. Of the hub
    angle, the change over `CHANGE_SPAN` is taken, scaled to the noise of one reading.
    """
    if channel == "hub_angle":
        first = time < time[0] + CHANGE_SPAN
        residual = np.where(first, residual, (residual - residual[_earlier(time)]) / np.sqrt(2))
    return np.clip(np.nan_to_num(residual, nan=0.0), -DIVERGED, DIVERGED)


def layout(
    prepared: Sequence[Prepared], compared: Callable[[str, Recording], np.ndarray]
) -> tuple[tuple[Group, ...], np.ndarray]:
    """Rows of each channel of each recording, and the weights (n): 1 where the channel can be compared, else 0.

    Args:
      prepared: the recordings.
      compared: of a channel and a recording, values (m) that are not finite where it cannot be compared.
    """
    groups, weights, row = [], [], 0
    for i, p in enumerate(prepared):
        for channel in p.channels:
            known = np.isfinite(compared(channel, p.recording))
            groups.append(Group(i, channel, slice(row, row + len(known))))
            weights.append(known.astype(float))
            row += len(known)
    return tuple(groups), np.concatenate(weights) if weights else np.zeros(0)


def _comparable(channel: str, recording: Recording) -> np.ndarray:
    """Not a number (m) where a channel is missing; of the hub angle, also where its earlier reading is."""
    blank = np.where(np.isfinite(recording[channel]), 1.0, np.nan)
    if channel != "hub_angle":
        return blank
    time = recording.time
    return blank + np.where(time < time[0] + CHANGE_SPAN, 0.0, blank[_earlier(time)])


def _earlier(time: np.ndarray) -> np.ndarray:
    """Index of the sample `CHANGE_SPAN` before each (m), of the first one where there is none."""
    return np.searchsorted(time, time - CHANGE_SPAN + ROUNDING)


def reversal_weights(bench: Workbench, fit: Fit) -> np.ndarray:
    """0 near reversals of the hub under Stribeck friction, otherwise 1 (n): where the torque is known locally in time.

    There the friction torque jumps by twice the break-away torque within milliseconds. The instant of the reversal is
    not known so well, and the filter spreads the jump.
    """
    weights = np.ones(len(fit.residual))
    if not fit.model.plant.friction.stribeck_velocity > 0:
        return weights
    for group in bench.data.groups:
        if group.channel == HUB_TORQUE and isinstance(bench.data, DrivenData):
            near = hub_balance.near_reversals(bench.data.views[group.recording])
            weights[group.rows] = ~near[group.instants]
    return weights
