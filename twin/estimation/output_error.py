"""Recordings as output errors: measured minus simulated, the simulation from the initial state and the command alone.

Where sticks and slips do not decide the rest of a run, this is the maximum-likelihood residual of white sensor noise
(L. Ljung, System Identification, 1999, ch. 7: output-error models). A rough hub sensor does not matter then, whose
noise excites the link where its measured angle drives it (`twin.residuals.data`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import cast

import numpy as np

from twin.estimation import chain_limit, loss
from twin.estimation.first_state import first_state
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.slopes import cost_of, costs_at, difference_jacobian, first_steps
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import CORRELATION_TIME, FreeData, Workbench, layout
from twin.mechanics.state import Start
from twin.recording import ON_LINK
from twin.residuals.data import BLOCK_SPAN, DrivenData
from twin.residuals.groups import split_into_blocks
from twin.residuals.noise import sensor_noise
from twin.residuals.residual import has_unknown_zero, without_zero
from twin.rigs.model import Model

BREAK_AWAY_CHANGE = 1e-3
"""Relative change of the break-away torque by which free runs are tried: a fit converges where it is not visible."""
FRICTION_SCATTER = 1e-2
"""Scatter of a break-away torque from one stick to the next, which no model knows."""
_LEAST_PREDICTABLE = 0.5
"""Share of the samples that chance may not decide: most of them."""
_HUB_SHARE = 0.9
"""Share of the variance of a channel's noise from which its own noise does not matter."""
_STATIC_ROUNDS = 3  # of the search for the static friction
_ITERATIONS = 20  # of a fit that may begin far from its minimum, as those of a calibration
_COULOMB_GRID = np.geomspace(0.7, 1.4, 7)
"""Coulomb friction of the grid over that of the first fit: its error is a few standard errors of a rough hub sensor."""
_STATIC_GRID = np.array([1.0, 1.15, 1.35, 1.6, 2.0])
"""Static over Coulomb friction of the grid."""
_FINE_GRID = np.linspace(1.0, 2.0, 41)
"""The same where the Coulomb friction is known: a stick more or less changes the rest of a run."""


class OutputErrorData(FreeData):
    """Residuals of free-running simulations; initial states of rigs that were moving are unknowns of the fit.

    Attributes:
      driven: the same recordings, the link driven by the measured hub.
    """

    def __init__(self, driven: DrivenData, ends: Mapping[int, int] = MappingProxyType({})):
        """Takes the recordings of driven data; of recording i, only the samples before `ends[i]` are compared."""
        self.driven = driven
        self.prepared = driven.prepared
        self.groups, self.weight = layout(self.prepared, lambda channel, recording: recording[channel])
        for g in self.groups:
            self.weight[g.rows][ends.get(g.recording, g.rows.stop) :] = 0.0
        periods = [p.recording.period for p in self.prepared]
        self.blocks = tuple(
            block
            for g in self.groups
            for block in split_into_blocks([g], self.weight, max(1, round(BLOCK_SPAN / periods[g.recording])))
        )

    def counts(self) -> np.ndarray:
        """Number of independent samples in each block (g): one per `CORRELATION_TIME`."""
        periods = [self.prepared[g.recording].recording.period for g in self.blocks]
        known = [self.weight[g.rows].sum() for g in self.blocks]
        return np.array(known) * np.minimum(1.0, np.array(periods) / CORRELATION_TIME)

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> measured minus simulated (m), in multiples of the noise, 0 where missing."""
        prepared = self.prepared[i]
        residuals = super().residual(model, i, start)
        for c, off in residuals.items():
            known = np.isfinite(prepared.recording[c])
            if has_unknown_zero(model, prepared, c):
                off = without_zero(off, known)
            residuals[c] = np.where(known, off, 0.0)
        return residuals


def is_repeatable(bench: Workbench, fit: Fit, change: float = BREAK_AWAY_CHANGE) -> bool:
    """Whether no stick or slip decides a free run of any recording.

    A relative change of the break-away torque must change no block by more than its noise, or than what the model
    leaves of it.
    """
    return not _decided(_output_errors(bench), fit, change).any()


def on_predictable_part(free: Workbench, fit: Fit) -> tuple[Workbench, Fit] | None:
    """The output errors without what comes after a stick or slip that is a matter of chance, and the fit to them.

    Friction that breaks away `FRICTION_SCATTER` later or earlier may decide the rest of one run, as where a command
    rests just below the static level. If it decides most of the recordings, the result is None.
    """
    ends: dict[int, int] = {}
    first = {(g.recording, g.channel): g.rows.start for g in free.data.groups}
    for g, decided in zip(free.groups, _decided(free, fit, FRICTION_SCATTER), strict=True):
        if decided:
            row = g.rows.start - first[g.recording, g.channel]
            ends[g.recording] = min(row, ends.get(g.recording, row))
    if not ends:
        return free, fit
    part = Workbench(OutputErrorData(driven_data(free), ends), free.pool)
    if part.weight.sum() < _LEAST_PREDICTABLE * free.weight.sum():
        return None
    part = part.with_defect(free.defect)
    return part, minimise(part, fit.model, fit.starts, fit.unknowns, fit.values, iterations=_ITERATIONS)


def _decided(free: Workbench, fit: Fit, change: float) -> np.ndarray:
    """Blocks (g) of output errors that a relative change of the break-away torque changes by more than is left there.

    What is left is the residual of the fit, or the noise where that is larger.
    """
    models = [fit.model, *(fit.model.with_break_away(1 + s * change) for s in (1, -1))]
    plain, *changed = free.residuals([(m, fit.starts, None) for m in models])
    left = np.maximum(1.0, free.sizes(plain))
    return np.any([free.sizes(other - plain) >= left for other in changed], axis=0)


def hub_sensor_dominates(bench: Workbench) -> bool:
    """Whether noise of the hub sensor is nearly all the noise of the link's channels, on every recording with a hub.

    The measured hub drives the link there. Where the share is small, driven data tell as much as free runs.
    """
    data, shares = driven_data(bench), []
    for p, view in zip(data.prepared, data.views, strict=True):
        if p.hub is not None:
            own = sensor_noise(p, {})
            link = [c for c in own if c in ON_LINK and np.isfinite(view.noise[c])]
            shares.append(max((1 - (own[c] / view.noise[c]) ** 2 for c in link), default=0.0))
    return bool(shares) and min(shares) > _HUB_SHARE


def driven_data(bench: Workbench) -> DrivenData:
    """The recordings of a bench with the link driven by the measured hub."""
    return bench.data.driven if isinstance(bench.data, OutputErrorData) else cast(DrivenData, bench.data)


def on_driven_data(bench: Workbench, fit: Fit) -> tuple[Workbench, Fit]:
    """The recordings with the link driven by the measured hub, and the residual of a fit there with its Jacobian."""
    if not isinstance(bench.data, OutputErrorData):
        return bench, fit
    driven = Workbench(bench.data.driven, bench.pool)
    driven, _ = chain_limit.without_discretisation_error(driven, fit.model, fit.starts, chain_limit.ROUGH)
    [r] = driven.residuals([(fit.model, fit.starts, None)])
    steps = first_steps(fit.unknowns)
    J, _ = difference_jacobian(driven, fit.model, fit.starts, fit.unknowns, fit.values, r, steps, {})
    cost = cost_of(driven, fit.unknowns, fit.values, r)
    return driven, replace(fit, residual=r, size=driven.sizes(r), cost=cost, jacobian=J)


def _output_errors(bench: Workbench) -> Workbench:
    return Workbench(OutputErrorData(driven_data(bench)), bench.pool)


def fit_output_error(bench: Workbench, fit: Fit, most: float = np.inf) -> tuple[Workbench, Fit] | None:
    """The output errors of the recordings of a bench, and the model of a fit fitted to them.

    Args:
      bench: the data.
      fit: the model, and where the fit starts.
      most: size that blocks may be left at, in noise levels; None where the fit does not come near that.
    """
    free = _output_errors(bench)
    goal = float(free.count.sum() * loss.loss(np.array(most)))
    states = tuple(first_state(fit.model, p, bench.pool) for p in bench.prepared)
    values = np.array([_value(u, v, states) for u, v in zip(fit.unknowns, fit.values, strict=True)])
    values = _likeliest_friction(free, fit, states, values, _COULOMB_GRID, _STATIC_GRID)
    first = minimise(free, fit.model, states, fit.unknowns, values, iterations=_ITERATIONS, goal=goal)
    if first.cost > goal:
        return None
    fitted = _with_likeliest_sticks(free, first)
    free, _ = chain_limit.without_discretisation_error(
        free, fitted.model, fitted.starts, chain_limit.STANDARD
    )
    at = fitted.model, fitted.starts, fitted.unknowns, fitted.values
    return free, minimise(free, *at, fixed_jacobian=fitted.jacobian_columns)


def _with_likeliest_sticks(free: Workbench, fitted: Fit) -> Fit:
    """The fit to output errors with its static friction searched for again, as long as this lowers the cost.

    With the sliding friction right, the static one may be seen to be wrong.
    """
    for _ in range(_STATIC_ROUNDS):
        values = _likeliest_friction(free, fitted, fitted.starts, fitted.values, np.ones(1), _FINE_GRID)
        other = minimise(free, fitted.model, fitted.starts, fitted.unknowns, values, iterations=_ITERATIONS)
        if other.cost >= fitted.cost:
            break
        fitted = other
    return fitted


def _likeliest_friction(
    free: Workbench,
    fit: Fit,
    states: Sequence[Start],
    values: np.ndarray,
    coulombs: np.ndarray,
    statics: np.ndarray,
) -> np.ndarray:
    """The values (p) with the friction levels at the best point of a grid: Coulomb over its value, static over Coulomb.

    Where the hub sticks decides the rest of a free run: a fit that starts with wrong levels ends in a local minimum.
    """
    index = {u.name: k for k, u in enumerate(fit.unknowns) if u.kind == "rig"}
    if not {"static_friction", "coulomb_friction"} <= index.keys():
        return values
    points = [values]
    for coulomb in coulombs * values[index["coulomb_friction"]]:
        for static in statics * coulomb:
            x = values.copy()
            x[index["coulomb_friction"]], x[index["static_friction"]] = coulomb, static
            points.append(np.clip(x, *np.transpose([u.bounds for u in fit.unknowns])))
    costs = costs_at(free, fit.model, states, fit.unknowns, points)
    return points[int(np.argmin(costs))]


def _value(u: Unknown, value: float, states: Sequence[Start]) -> float:
    """The value of an unknown; of an initial state, that of these states."""
    if u.kind != "start" or u.recording is None:
        return float(value)
    attribute = getattr(states[u.recording], u.name)
    return float(attribute if u.index is None else attribute[u.index])
