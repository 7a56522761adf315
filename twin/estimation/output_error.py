"""Recordings as output errors: measured minus simulated, the simulation from the initial state and the command.

Where sticks and slips do not decide the rest of a run, this is the maximum-likelihood residual of white sensor noise
(L. Ljung, System Identification, 1999, ch. 7: output-error models). A rough hub sensor does not matter then, whose
noise excites the link where its measured angle drives it (`twin.residuals.data`).

Where they do decide it, a soft spring pulls the simulated hub to the measured one, see `twin.mechanics.hub_spring`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from twin.effects import REGISTRY
from twin.estimation import chain_limit, loss, refine
from twin.estimation.first_state import first_states, with_bends
from twin.estimation.fit import Fit
from twin.estimation.minimise import FAR_ITERATIONS, QUICK_ITERATIONS, minimise
from twin.estimation.slopes import difference_jacobian, first_steps
from twin.estimation.unknowns import Unknown, start_unknowns
from twin.estimation.workbench import CORRELATION_TIME, FreeData, Workbench, layout
from twin.mechanics.hub_spring import MeasuredHub, Spring, spring_of
from twin.mechanics.state import Start
from twin.recording import ON_LINK
from twin.residuals.data import BLOCK_SPAN, DrivenData
from twin.residuals.filters import GRID, REACH
from twin.residuals.groups import split_into_blocks
from twin.residuals.noise import sensor_noise
from twin.residuals.numerics import ROUNDING
from twin.residuals.prepared import sensor_corrected_start
from twin.residuals.residual import has_unknown_zero, without_zero
from twin.residuals.view import hub_trajectory
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

_HUB_SHARE = 0.9
"""Share of the variance of a channel's noise from which its own noise does not matter."""
_PERIODS = 0.5, 1.0, 2.0
"""Periods in which the rig oscillates about the measured hub, see `OutputErrorData` [s]."""
_DAMPING_RATIOS = 0.5, 0.0
"""Damping ratios of these oscillations: an error is gone after a period, or lasts where the rig has no damping."""
STIFFEST = _PERIODS[0], _DAMPING_RATIOS[0]
"""Period [s] and damping ratio of the oscillation on the stiffest of these springs."""


class OutputErrorData(FreeData):
    """Residuals of simulations from the first sample; initial states of rigs that were moving are unknowns of the fit.

    Attributes:
      driven: the same recordings, the link driven by the measured hub.
      period, damping_ratio: of the rig's oscillation about the measured hub [s], [1]; infinite in free runs.
      spring: between the simulated hub and the measured one.
      strides: of the samples of each recording, every so many are compared.
    """

    def __init__(self, driven: DrivenData, model: Model, period: float = np.inf, damping_ratio: float = 0.0):
        """Takes the recordings of driven data, a model for which the spring is made, period and damping ratio."""
        self.driven, self.period, self.damping_ratio = driven, period, damping_ratio
        self.spring = spring_of(model.plant, period, damping_ratio)
        self.prepared = driven.prepared
        # Of faster samples, those of the grid of driven data tell as much.
        self.strides = tuple(max(1, int(GRID / p.recording.period + ROUNDING)) for p in self.prepared)
        compared = [
            replace(p, recording=p.recording.part(slice(None, None, stride)))
            for p, stride in zip(self.prepared, self.strides, strict=True)
        ]
        self.groups, self.weight = layout(compared, lambda channel, recording: recording[channel])
        counts = [len(p.recording.time) for p in compared]
        self.blocks = tuple(
            block
            for g in self.groups
            for block in split_into_blocks(
                [g], self.weight, counts, max(1, round(BLOCK_SPAN / self.row_period(g.recording)))
            )
        )

    def row_period(self, i: int) -> float:
        """Time between two samples of recording i that are compared [s]."""
        return self.strides[i] * self.prepared[i].recording.period

    @property
    def is_free(self) -> bool:
        """Whether the simulations run freely."""
        return self.period == np.inf

    def is_stiffer(self, period: float, damping_ratio: float) -> bool:
        """Whether the spring is stiffer than one of this period [s], or as stiff and of another damping ratio [1]."""
        other = damping_ratio != self.damping_ratio and not self.is_free
        return self.period < period or (self.period == period and other)

    def counts(self) -> np.ndarray:
        """Number of independent samples in each block (g): one per `CORRELATION_TIME`."""
        periods = [self.row_period(g.recording) for g in self.blocks]
        known = [self.weight[g.rows].sum() for g in self.blocks]
        return np.array(known) * np.minimum(1.0, np.array(periods) / CORRELATION_TIME)

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> measured minus simulated (m), in multiples of the noise, 0 where missing."""
        prepared, residuals = self.prepared[i], dict[str, np.ndarray]()
        measured, start = prepared.recording, sensor_corrected_start(model, prepared, start)
        simulated = simulate(model, measured, start, spring=self._pull(model, i), stride=self.strides[i])
        for c in prepared.channels:
            reading = measured[c][:: self.strides[i]]
            off = (reading - simulated[c]) / prepared.noise[c]
            known = np.isfinite(reading)
            if has_unknown_zero(model, prepared, c):
                off = without_zero(off, known)
            residuals[c] = np.where(known, off, 0.0)
        return residuals

    def _pull(self, model: Model, i: int) -> tuple[Spring, MeasuredHub] | None:
        """The spring to the measured hub of recording i; None for a free run, or where no hub is measured.

        Near the first sample, the low-pass does not know the rate of the hub.
        """
        if self.spring.stiffness == 0 or self.prepared[i].hub is None:
            return None
        hub = hub_trajectory(self.driven.views[i], model)
        return self.spring, MeasuredHub(REACH, GRID, hub.angle, hub.rate)


def hub_sensor_dominates(bench: Workbench) -> bool:
    """Whether noise of the hub sensor is nearly all the noise of the link's channels, in the median recording.

    The measured hub drives the link there. Where the share is small, driven data tell as much as free runs. A recording
    in which the hub moves little has less of it, and tells less.
    """
    data, shares = driven_data(bench), []
    for p, view in zip(data.prepared, data.views, strict=True):
        if p.hub is not None:
            own = sensor_noise(p, {})
            link = [c for c in own if c in ON_LINK and np.isfinite(view.noise[c])]
            shares.append(max((1 - (own[c] / view.noise[c]) ** 2 for c in link), default=0.0))
    return bool(shares) and float(np.median(shares)) > _HUB_SHARE


def driven_data(bench: Workbench) -> DrivenData:
    """The recordings of a bench with the link driven by the measured hub."""
    return bench.data.driven if isinstance(bench.data, OutputErrorData) else cast(DrivenData, bench.data)


def on_driven_data(bench: Workbench, fit: Fit) -> tuple[Workbench, Fit]:
    """The recordings with the link driven by the measured hub, and the residual of a fit there with its Jacobian."""
    if not isinstance(bench.data, OutputErrorData):
        return bench, fit
    driven = Workbench(bench.data.driven, bench.pool)
    driven = chain_limit.with_limit(driven, fit.model, fit.starts, chain_limit.STANDARD)
    fit = refine.evaluated_on(driven, fit)
    at, steps = (driven, fit.model, fit.starts, fit.unknowns), first_steps(fit.unknowns)
    J, _ = difference_jacobian(*at, fit.values, fit.residual, steps, {})
    return driven, replace(fit, jacobian=J)


@dataclass(frozen=True, eq=False)
class _Run:
    """A fit to output errors with a spring, or without one.

    Attributes:
      data: the output errors.
      bench: for these.
      fit: the model fitted to them.
    """

    data: OutputErrorData
    bench: Workbench
    fit: Fit


def fit_output_error(bench: Workbench, fit: Fit, most: float = np.inf) -> tuple[Workbench, Fit] | None:
    """The output errors of the recordings of a bench, and the model of a fit fitted to them.

    Of the springs, the one with the largest likelihood is taken, as the gain of an observer is estimated (Ljung 1999,
    ch. 7.4): stiff and damped ones let through more of the noise of the hub sensor, the others more of the error of the
    model.

    Args:
      bench: the data; of output errors, the search for a spring begins with theirs.
      fit: the model, and where the fit starts.
      most: misfit that the first spring may leave [nat]; None where the fit leaves more.
    """
    best = _likeliest_run(bench, fit, most)
    if best is None:
        return None
    free, fitted = best.bench, _fitted(best.bench, best.fit, jacobian=best.fit.jacobian)
    exact, remaining = chain_limit.without_discretisation_error(
        free, fitted.model, fitted.starts, chain_limit.STANDARD
    )
    at, slopes = (fitted.model, fitted.starts, fitted.unknowns), fitted.jacobian_columns
    corrected = minimise(exact, *at, fitted.values, fixed_jacobian=slopes)
    # Where the discretisation decides a stick, its error is no small correction.
    if corrected.cost > fitted.cost:
        return free, fitted
    exact = exact.with_remaining_error(remaining)
    slopes = {key: column / exact.deviation for key, column in slopes.items()}
    return exact, minimise(exact, *at, corrected.values, fixed_jacobian=slopes)


def _likeliest_run(bench: Workbench, fit: Fit, most: float) -> _Run | None:
    """The likeliest of rough fits with springs, and without; arguments as `fit_output_error`.

    Each begins at the likeliest before it, the second one also at other minima. The spring softens as long as that is
    likelier, and once more with the other damping ratio. A free run has two parameters less than a spring, and may be
    less likely by their penalty.
    """
    best = _with_own_spring(bench, fit) or _rough_run(bench, fit, most, None, *STIFFEST)
    if best is None:
        return None
    best = _at_likeliest_minimum(best)
    for ratio in _DAMPING_RATIOS:
        for period in _PERIODS:
            if best.data.is_stiffer(period, ratio):
                run = _rough_run(bench, fit, most, best, period, ratio)
                if run is None:
                    break
                best = run
    if best.data.is_free:
        return best
    return _rough_run(bench, fit, most, best, np.inf, 0.0, best.bench.penalty(2)) or best


def _with_own_spring(bench: Workbench, fit: Fit) -> _Run | None:
    """A fit to output errors, with their spring; None of one to driven data."""
    if not isinstance(bench.data, OutputErrorData):
        return None
    data = OutputErrorData(bench.data.driven, fit.model, bench.data.period, bench.data.damping_ratio)
    free = Workbench(data, bench.pool)
    return _Run(data, free, refine.evaluated_on(free, fit))


def _at_likeliest_minimum(run: _Run) -> _Run:
    """The likeliest of rough fits that begin at a run and at the other minima of its effects; without any, the run."""
    effects = run.fit.model.effects
    others = [
        _with_effect_values(run.fit, name, values)
        for name in effects
        for values in REGISTRY[name].other_minima(effects[name])
    ]
    if not others:
        return run
    best = _fitted(run.bench, run.fit, run.fit.cost)
    for other in others:
        best = min(best, _fitted(run.bench, other, best.cost), key=lambda f: f.cost)
    return replace(run, fit=best)


def _with_effect_values(fit: Fit, name: str, parameters: Mapping[str, float]) -> Fit:
    """The fit with the unknowns of an effect at these parameters."""
    pairs = zip(fit.unknowns, fit.values, strict=True)
    values = np.array([u.turned(parameters[u.name]) if u.effect == name else v for u, v in pairs])
    return replace(fit, values=values)


def _rough_run(
    bench: Workbench,
    fit: Fit,
    most: float,
    best: _Run | None,
    period: float,
    ratio: float,
    less: float = 0.0,
) -> _Run | None:
    """A rough fit with a spring; None where it is not likelier than the best before it.

    Args:
      bench, fit, most: as `fit_output_error`, for the first fit.
      best: where a later one begins.
      period, ratio: of the spring [s], [1].
      less: by how much it may be less likely [nat].
    """
    data = OutputErrorData(driven_data(bench), fit.model, period, ratio)
    free = Workbench(data, bench.pool)
    if best is None:
        start = _as_start(bench, fit)
        goal = most + float(free.count.sum() * loss.loss(np.ones(())))
    else:
        start, goal = best.fit, best.fit.cost + less
    # A spring forgets the initial state. The first fit begins far from its minimum, and gains unevenly on the way.
    fitted = (_fitted if best is None or data.is_free else _minimised)(
        free, start, np.inf if best is None else goal
    )
    return _Run(data, free, fitted) if fitted.cost < goal else None


def _as_start(bench: Workbench, fit: Fit) -> Fit:
    """The fit; one to driven data, with the initial states of output errors."""
    if isinstance(bench.data, OutputErrorData):
        return fit
    return _with_states(fit, first_states(fit.model, bench.prepared, bench.pool))


def _likelier_states(bench: Workbench, fit: Fit) -> tuple[list[Start], float]:
    """Of each recording, the likelier initial state: that of the fit, or one found anew from the measured state.

    Another model, which lacked an effect, may have moved those of the fit to another minimum, in which only the first
    block of a recording is off.

    Returns:
      The states, and the misfit that they save [nat].
    """
    anew = with_bends(bench.prepared, fit.model, bench.pool)
    unknowns = start_unknowns(anew)
    if not unknowns:
        return list(fit.starts), 0.0
    found = minimise(bench, fit.model, [p.start for p in anew], unknowns)
    gained = bench.by_recording(bench.misfits(fit.residual) - bench.misfits(found.residual))
    pairs = zip(fit.starts, found.starts, gained, strict=True)
    return [new if gain > 0 else old for old, new, gain in pairs], float(gained[gained > 0].sum())


def _with_states(fit: Fit, states: Sequence[Start]) -> Fit:
    """The fit with its unknown initial states at these."""
    values = np.array([_value(u, v, states) for u, v in zip(fit.unknowns, fit.values, strict=True)])
    return replace(fit, starts=tuple(states), values=values)


def _fitted(free: Workbench, fit: Fit, goal: float | None = None, jacobian: np.ndarray | None = None) -> Fit:
    """The model fitted to output errors, from the fit on and, where these are likelier, from other initial states.

    Arguments as `_minimised`.
    """
    fitted = _minimised(free, fit, goal, jacobian)
    states, gained = _likelier_states(free, fitted)
    if gained < refine.MIN_GAIN:
        return fitted
    again = _minimised(free, _with_states(fitted, states), goal, fitted.jacobian)
    return min(fitted, again, key=lambda f: f.cost)


def _minimised(
    free: Workbench, fit: Fit, goal: float | None = None, jacobian: np.ndarray | None = None
) -> Fit:
    """The model fitted to output errors, from the fit on.

    Args:
      free: the output errors.
      fit: where the fit begins.
      goal: the fit is made to 1 nat, and given up where its cost would stay above this; to convergence without one.
        Where it is infinite, the fit may begin far from its minimum.
      jacobian: (n x p) near there, if it is known.
    """
    at = free, fit.model, fit.starts, fit.unknowns, fit.values
    if goal is None:
        return minimise(*at, iterations=FAR_ITERATIONS, first_jacobian=jacobian)
    iterations = QUICK_ITERATIONS if goal < np.inf else FAR_ITERATIONS
    return minimise(*at, iterations=iterations, tolerance=1.0, goal=goal, first_jacobian=jacobian)


def _value(u: Unknown, value: float, states: Sequence[Start]) -> float:
    """The value of an unknown; of an initial state, that of these states."""
    if u.kind != "start" or u.recording is None:
        return float(value)
    attribute = getattr(states[u.recording], u.name)
    return float(attribute if u.index is None else attribute[u.index])
