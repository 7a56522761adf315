"""Fits of a model to recordings: declared parameters within their uncertainty, effects freely."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from scipy.optimize import lsq_linear

from twin import evidence
from twin.effects import REGISTRY
from twin.effects.base import OPEN
from twin.mechanics.state import Start
from twin.parameters import declared_range, relative_uncertainty
from twin.recording import Recording
from twin.residuals.groups import Group
from twin.residuals.prepared import Prepared, guided, reading_start, shortest_period
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

MEMORY = 0.25
"""Span over which a change of the hub angle is compared [s]."""
CORRELATION = 0.05
"""Span over which a misfit is taken as one piece of evidence while fitting [s]."""
_TRIALS, _SECANTS = 5, 4  # trials of a step with a new Jacobian; steps with one that was put right
_PACE = 3.0  # times what the last iteration gained that those to come may gain
_VISIBLE = 0.5  # a finite difference moves the residual by this many noise levels (rms)
_REACH = 3.0  # standard deviations by which a declared parameter may be off
_RIGID = ("torque_limit",)


Key = tuple[str, str, int | None]


@dataclass(frozen=True)
class Unknown:
    """One number that a fit may move.

    Attributes:
      owner: effect name, "rig", "clock", or "start" for the state at the first sample of one recording.
      name: parameter.
      start: first value.
      scale: prior standard deviation for a declared parameter, else a small but visible size.
      prior: whether `scale` is a prior about `start`.
      bounds: range.
      recording: index of the only recording that it acts on, or None.
      inverse: whether the number is one over the parameter's value.
    """

    owner: str
    name: str
    start: float
    scale: float
    prior: bool
    bounds: tuple[float, float]
    recording: int | None = None
    inverse: bool = False

    @property
    def key(self) -> Key:
        """What tells it from all others of a fit: each recording has first states of its own."""
        return self.owner, self.name, self.recording

    @property
    def of_rig(self) -> bool:
        """Whether it is a parameter of the rig or of its effects, and not of one recording or of the card."""
        return self.owner not in ("clock", "start")

    @property
    def full_name(self) -> str:
        """The parameter as a parameter file names it in its correlations: those of effects by effect.parameter."""
        return self.name if self.owner == "rig" else f"{self.owner}.{self.name}"

    def turned(self, value: float) -> float:
        """The parameter's value for the number that a fit moves, and the other way round."""
        if not self.inverse:
            return value
        return 1 / value if value else math.inf


def replaced_parameters(model: Model) -> set[str]:
    """Declared parameters that a model's effects take over."""
    return {p for name in model.effects for p in REGISTRY[name].replaces}


def declared_unknowns(model: Model) -> list[Unknown]:
    """Declared parameters that may move within their uncertainty."""
    found, gone = [], replaced_parameters(model)
    for name, parameter in model.declared.parameters.items():
        relative = relative_uncertainty(parameter)
        scale = relative * abs(parameter.value)
        if name not in _RIGID and name not in gone and scale > 0:
            # Within the uncertainty: what would have to move further is not calibration.
            bounds = declared_range(parameter, _REACH)
            found.append(Unknown("rig", name, parameter.value, scale, True, bounds))
    return found


def clock_unknown(prepared: Sequence[Prepared]) -> Unknown:
    """When within a sample a card puts its commands out: nobody declares that to a tenth of a sample.

    Nothing that the model lacks follows from it. An effect may look like it, so that it stays open beside all of them.
    """
    most = OPEN * shortest_period(prepared)
    return Unknown("clock", "late", 0.0, most / 2, True, (-most, most))


def effect_unknowns(model: Model, effect: str, values: Mapping[str, float], seen: set[str]) -> list[Unknown]:
    """Parameters of an effect that these channels can say something about."""
    return [
        Unknown(effect, p.name, p.turned(values[p.name]), abs(p.step), False, p.span, inverse=p.inverse)
        for p in REGISTRY[effect].free(values)
        if p.channel is None or p.channel in seen
    ]


def known_effect_unknowns(
    model: Model, errors: Mapping[str, Mapping[str, float]], seen: set[str]
) -> list[Unknown]:
    """Parameters of the effects that a model begins with; those with a standard error (effect -> name) have a prior."""
    found = []
    for effect, values in model.effects.items():
        for u in effect_unknowns(model, effect, values, seen):
            error = errors.get(effect, {}).get(u.name)
            if error is None:
                found.append(u)
            elif error > 0:
                scale = error * u.start**2 if u.inverse else error
                found.append(replace(u, scale=scale, prior=True))
    return found


@dataclass(frozen=True)
class Fit:
    """A model at its best, and how well the data determine it.

    Attributes:
      model: the fitted model.
      starts: state of each recording at its first sample.
      unknowns: what was fitted (p).
      values, errors: (p) and their standard errors.
      covariance: (p x p).
      residual: (n) in noise units.
      size: (g) root-mean-square of each group.
      cost: what was minimised.
      jacobian: (n x p) of the residual.
    """

    model: Model
    starts: tuple[Start, ...]
    unknowns: tuple[Unknown, ...]
    values: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    size: np.ndarray
    cost: float
    jacobian: np.ndarray = field(repr=False)

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def slopes(self) -> dict[Key, np.ndarray]:
        """`Unknown.key` -> what it changes in the residual (n)."""
        return {u.key: self.jacobian[:, j] for j, u in enumerate(self.unknowns)}


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
        return evidence.group_sizes(residual, self.groups, self.weight)

    def cost(self, residual: np.ndarray) -> float:
        """What a residual (n) costs, priors apart."""
        return float(self.count @ evidence.loss(self.sizes(residual)))

    def misfit(self, residual: np.ndarray) -> float:
        """What a residual (n) costs above pure noise."""
        return float(self.count @ np.maximum(evidence.loss(self.sizes(residual)) - 0.5, 0.0))


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


def placed(model: Model, unknowns: Sequence[Unknown], values: np.ndarray) -> Model:
    """The model with the unknowns at these values (p)."""
    rig = {u.name: float(v) for u, v in zip(unknowns, values, strict=True) if u.owner == "rig"}
    effects = {name: dict(p) for name, p in model.effects.items()}
    for u, v in zip(unknowns, values, strict=True):
        if u.owner in effects:
            effects[u.owner][u.name] = u.turned(float(v))
    clock = {u.name: float(v) for u, v in zip(unknowns, values, strict=True) if u.owner == "clock"}
    declared = model.declared.replace(source="fitted", **rig) if rig else model.declared
    return model.replace(declared=declared, effects=effects, **clock)


def placed_starts(
    starts: Sequence[Start], unknowns: Sequence[Unknown], values: np.ndarray
) -> tuple[Start, ...]:
    """The starts with the unknowns at these values (p)."""
    changed = list(starts)
    for u, v in zip(unknowns, values, strict=True):
        if u.owner == "start" and u.recording is not None:
            changed[u.recording] = _moved(changed[u.recording], u.name, float(v))
    return tuple(changed)


def _moved(start: Start, name: str, value: float) -> Start:
    if name == "hub_angle":
        return replace(start, hub_angle=value)
    if name == "hub_rate":
        return replace(start, hub_rate=value)
    attribute, index = name.rsplit("_", 1)
    if attribute == "bend":
        return replace(start, bend=_put(start.bend, int(index), value))
    return replace(start, bend_rate=_put(start.bend_rate, int(index), value))


def _put(pair: tuple[float, float], index: int, value: float) -> tuple[float, float]:
    return (value, pair[1]) if index == 0 else (pair[0], value)


def placed_both(
    model: Model, starts: Sequence[Start], unknowns: Sequence[Unknown], x: np.ndarray
) -> tuple[Model, tuple[Start, ...]]:
    """The model and the first states with the unknowns at some values (p)."""
    return placed(model, unknowns, x), placed_starts(starts, unknowns, x)


def start_unknowns(prepared: Sequence[Prepared]) -> list[Unknown]:
    """State at the first sample of every recording that did not start at rest."""
    found = []
    for i, p in enumerate(prepared):
        if p.recording.start != "unknown":
            continue
        if p.hub is not None:
            angle, rate = p.noise["hub_angle"], 30 * p.noise["hub_angle"]
            found.append(Unknown("start", "hub_angle", p.start.hub_angle, angle, False, (-1e3, 1e3), i))
            found.append(Unknown("start", "hub_rate", p.start.hub_rate, rate, False, (-1e3, 1e3), i))
        for mode in (0, 1):
            found.append(Unknown("start", f"bend_{mode}", p.start.bend[mode], 1e-4, False, (-1.0, 1.0), i))
            found.append(
                Unknown("start", f"bend_rate_{mode}", p.start.bend_rate[mode], 1e-2, False, (-1e2, 1e2), i)
            )
    return found


def minimise(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    values: np.ndarray | None = None,
    fixed_jacobian: Mapping[Key, np.ndarray] | None = None,
    iterations: int = 8,
    tolerance: float = 0.05,
    report: Callable[[str], None] = lambda text: None,
    goal: float = np.inf,
) -> Fit:
    """Levenberg-Marquardt on the groups' losses, each group weighted by its own size.

    Between two Jacobians by differences, steps are taken with the one that the last step has put right, as long as
    they gain: one simulation each in place of one for each unknown.

    Args:
      bench: the recordings.
      model: where to start; its effects contain those of the unknowns.
      starts: states at the first samples.
      unknowns: what may move (p).
      values: (p) first values; by default the unknowns' own.
      fixed_jacobian: columns (n) that need not be computed again, by their `key`: a chord method.
      iterations: at most so many.
      tolerance: a step that gains less than this in cost is the last.
      report: told of every iteration.
      goal: cost that it is worth going on for: given up is what would not get there at three times its pace.
    """
    unknowns = tuple(unknowns)
    x = np.array([u.start for u in unknowns]) if values is None else np.array(values, dtype=float)
    steps = np.array([0.1 * u.scale if u.prior else u.scale for u in unknowns])
    fixed = fixed_jacobian or {}
    [r] = bench.residuals([(*placed_both(model, starts, unknowns, x), None)])
    at = _Point(x, r, cost_of(bench, unknowns, x, r), 1e-3)
    J = np.zeros((len(r), len(unknowns)))
    for iteration in range(iterations):
        before, enough = at.cost, tolerance * max(1.0, 1e-3 * at.cost)
        J, steps = _jacobian(bench, model, starts, unknowns, at.x, at.residual, steps, fixed)
        for trials in (_TRIALS, *(1,) * _SECANTS):
            better = _improved(bench, model, starts, unknowns, at, J, trials)
            gained = at.cost - better.cost
            if better is not at:
                J = _secant(J, better.x - at.x, better.residual - at.residual, steps)
            at = better
            if gained < enough:
                break
        report(f"iteration {iteration + 1}: cost {at.cost:.1f}")
        if before - at.cost < enough:
            break
        if at.cost - _PACE * (before - at.cost) * (iterations - 1 - iteration) > goal:
            break
    x, r, cost = at.x, at.residual, at.cost
    size = bench.sizes(r)
    fitted, states = placed_both(model, starts, unknowns, x)
    information, _ = equations_at(bench, unknowns, x, r, J)
    return Fit(fitted, states, unknowns, x, np.linalg.pinv(information, hermitian=True), r, size, cost, J)


@dataclass(frozen=True, eq=False)
class _Point:
    """Where a fit stands: values (p), residual (n), cost, and damping of the next step."""

    x: np.ndarray
    residual: np.ndarray
    cost: float
    damping: float


def _improved(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    at: _Point,
    J: np.ndarray,
    trials: int,
) -> _Point:
    """The first of some trials, each damped more than that before it, that costs less; else the point itself."""
    damping = at.damping
    for _ in range(trials):
        trial = _step(bench, unknowns, at.x, at.residual, J, damping)
        [r] = bench.residuals([(*placed_both(model, starts, unknowns, trial), None)])
        cost = cost_of(bench, unknowns, trial, r)
        if cost < at.cost:
            return _Point(trial, r, cost, damping / 10)
        damping = max(10 * damping, 1e-2)
    return at


def _secant(J: np.ndarray, moved: np.ndarray, change: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The Jacobian (n x p) that agrees with the change (n) of a move (p), all else as it was (C. G. Broyden, 1965).

    `steps` (p) are moves of each unknown that are about equally visible.
    """
    scaled = moved / steps**2
    length = float(scaled @ moved)
    return J + np.outer(change - J @ moved, scaled / length) if length > 0 else J


def costs_at(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    points: Sequence[np.ndarray],
) -> np.ndarray:
    """Cost at each of some points (p,) of the unknowns."""
    residuals = bench.residuals([(*placed_both(model, starts, unknowns, x), None) for x in points])
    return np.array([cost_of(bench, unknowns, x, r) for x, r in zip(points, residuals, strict=True)])


def prior_precision(unknowns: Sequence[Unknown]) -> np.ndarray:
    """One over the variance of each prior (p); 0 where there is none."""
    return np.array([1 / u.scale**2 if u.prior else 0.0 for u in unknowns])


def cost_of(bench: Workbench, unknowns: Sequence[Unknown], x: np.ndarray, r: np.ndarray) -> float:
    """Cost of values (p) of the unknowns whose residual is r (n), priors included."""
    prior = sum(0.5 * ((v - u.start) / u.scale) ** 2 for u, v in zip(unknowns, x, strict=True) if u.prior)
    return float(bench.cost(r) + prior)


def row_weights(bench: Workbench, r: np.ndarray) -> np.ndarray:
    """Weight of each residual (n) where every group is weighted by its own size."""
    starts = [g.rows.start for g in bench.groups]
    total = np.maximum(np.add.reduceat(bench.weight, starts), 1)
    of_group = bench.count / total / np.maximum(1.0, bench.sizes(r)) ** 2
    return np.repeat(of_group, [g.rows.stop - g.rows.start for g in bench.groups]) * bench.weight


def equations_at(
    bench: Workbench, unknowns: Sequence[Unknown], x: np.ndarray, r: np.ndarray, J: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information (p x p) and gradient (p) at values x (p) with residual r (n) and slopes J (n x p)."""
    weights = row_weights(bench, r)
    prior = prior_precision(unknowns)
    away = np.array([v - u.start for u, v in zip(unknowns, x, strict=True)])
    return J.T @ (weights[:, None] * J) + np.diag(prior), J.T @ (weights * r) + prior * away


def normal_equations(bench: Workbench, base: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Information (p x p) and gradient (p) of a fit's unknowns where it stands."""
    return equations_at(bench, base.unknowns, base.values, base.residual, base.jacobian)


def slope_gain(bench: Workbench, base: Fit, columns: np.ndarray, replaced: Sequence[str] = ()) -> float:
    """Gain in cost that unknowns with these slopes (n x k) promise, the base's unknowns free to give way.

    Half the drop of the weighted squares, turned into the groups' losses: to noise, it is n log of the sizes' ratio.
    """
    change, _ = slope_move(bench, base, columns, replaced)
    return bench.cost(base.residual) - bench.cost(base.residual + change)


def slope_move(
    bench: Workbench, base: Fit, columns: np.ndarray, replaced: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Change of the residual (n) to which slopes lead, and the move (k) of the unknowns with these slopes (n x k).

    Declared parameters that the effect replaces no longer count as the base's.
    """
    weights = row_weights(bench, base.residual)
    kept = np.array([u.owner != "rig" or u.name not in replaced for u in base.unknowns])
    prior = prior_precision(base.unknowns)[kept]
    away = np.array([v - u.start for u, v in zip(base.unknowns, base.values, strict=True)])[kept]
    J = np.hstack([base.jacobian[:, kept], columns])
    normal = J.T @ (weights[:, None] * J) + np.diag(np.r_[prior, np.zeros(columns.shape[1])])
    gradient = J.T @ (weights * base.residual) + np.r_[prior * away, np.zeros(columns.shape[1])]
    low, high = np.array([u.bounds for u in base.unknowns])[kept].T
    here = base.values[kept]
    beyond = np.full(columns.shape[1], np.inf)
    move = bounded_move(normal, gradient, np.r_[low - here, -beyond], np.r_[high - here, beyond])
    return J @ move * bench.weight, move[len(here) :]


def bounded_move(normal: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The move (p) within bounds that minimises gradient' m + m' normal m / 2."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 1e-10 * values.max()))
    system, right = (vectors * root).T, -(vectors / root).T @ (gradient / scale)
    bounds = (np.minimum(low * scale, -1e-9), np.maximum(high * scale, 1e-9))
    return lsq_linear(system, right, bounds).x / scale


def _step(
    bench: Workbench,
    unknowns: Sequence[Unknown],
    x: np.ndarray,
    r: np.ndarray,
    J: np.ndarray,
    damping: float,
) -> np.ndarray:
    normal, gradient = equations_at(bench, unknowns, x, r, J)
    ridge = damping * np.diag(normal) + 1e-12 * np.trace(normal) / len(x)
    low, high = np.array([u.bounds for u in unknowns]).T
    free = np.ones(len(x), dtype=bool)
    # Unknowns that would leave their range stay on its edge; the others are solved for again.
    for _ in range(len(x)):
        move = np.zeros(len(x))
        system = normal[np.ix_(free, free)] + np.diag(ridge[free])
        move[free] = -np.linalg.lstsq(system, gradient[free], rcond=None)[0]
        beyond = free & ((x + move < low) | (x + move > high))
        at_edge = beyond & ((np.abs(x - low) < 1e-15) | (np.abs(x - high) < 1e-15))
        if not at_edge.any():
            break
        free &= ~at_edge
    return np.clip(x + move, low, high)


def _jacobian(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    x: np.ndarray,
    r: np.ndarray,
    steps: np.ndarray,
    fixed: Mapping[Key, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Forward differences (n x p); the next steps (p) are those that move the residual visibly."""
    J, steps = np.zeros((len(r), len(unknowns))), steps.copy()
    jobs, columns = [], []
    for j, u in enumerate(unknowns):
        if u.key in fixed:
            J[:, j] = fixed[u.key]
            continue
        low, high = u.bounds
        up, down = high - x[j], x[j] - low
        moved = x.copy()
        moved[j] += min(steps[j], up) if up >= min(steps[j], down) else -min(steps[j], down)
        columns.append((j, moved[j] - x[j]))
        jobs.append((*placed_both(model, starts, unknowns, moved), u.recording))
    for (j, h), moved_r in zip(columns, bench.residuals(jobs), strict=True):
        only = unknowns[j].recording
        change = moved_r - r
        for group in bench.groups:
            if only is not None and group.recording != only:
                change[group.rows] = 0.0
        J[:, j] = change / h
        visible = np.sqrt(np.mean(change**2))
        limit = unknowns[j].scale if unknowns[j].prior else 1e3 * abs(h)
        steps[j] = min(abs(h) * np.clip(_VISIBLE / max(visible, 1e-12), 1e-2, 1e2), limit)
    return J, steps
