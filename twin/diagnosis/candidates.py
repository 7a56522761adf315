"""Candidates of one round: each effect of the library, scored beside a fitted model.

All effects are scored by a score test: the gain in log likelihood that the derivatives of the residual at neutral
predict, the calibration free to compensate. The effects with the best score tests are then fitted. The score of a
fitted effect is its penalised log-likelihood ratio.

A neutral value is a boundary or a singular point for many effects, so a fit has to start away from it. Start points
lie on rays: straight lines from neutral in the space of the effect's parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin import labels
from twin.diagnosis import spectrum
from twin.diagnosis.fit_start import fit_unknowns, initial_values, without_replaced_errors
from twin.diagnosis.permutation import Slopes
from twin.diagnosis.rays import (
    Reached,
    best_on_rays,
    point_on_ray,
    rays,
    size_of,
    visible_length,
    with_effect,
)
from twin.diagnosis.spectrum import Peak
from twin.effects import REGISTRY
from twin.estimation import output_error
from twin.estimation.fit import Fit
from twin.estimation.minimise import QUICK_ITERATIONS, minimise
from twin.estimation.slopes import linear_gain, linear_move
from twin.estimation.unknowns import model_and_starts_at
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent
from twin.residuals.data import DrivenData
from twin.residuals.numerics import ROUNDING
from twin.residuals.prepared import shortest_period
from twin.rigs.channel_errors import with_replaced_errors
from twin.rigs.model import Model

CONTENDERS = 3
"""Candidates that are fitted to convergence at most. As many at least are fitted before, and twice as many at most: of
these, those with a positive score test."""
STRAIN = 2.0
"""Standard deviations from its declared value beyond which a calibrated parameter is suspect."""
SLOPE_FACTOR = 15.0
"""A finite difference may change the residual by up to this factor more or less than by one noise level."""
_PROMISING = 0.5
"""Share of the misfit that a score has to reach for the round to need no candidates of large size; and of the best
score that one of these has to gain, nothing else being fitted, to be fitted."""
_HIDDEN_SHARES = (0.25, 0.5, 0.75)
"""Shares of a declared parameter that an effect which it hides may be."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model with one more effect.

    Attributes:
      effects: names of its effects, in the order of adoption; the last one is the candidate.
      fit: the fit of the model; if the candidate was not fitted, the fit of the model without it.
      score: gain in log likelihood over the model without it, less the penalty of its parameters.
    """

    effects: tuple[str, ...]
    fit: Fit
    score: float

    @property
    def name(self) -> str:
        """Name of the effect that is the candidate."""
        return self.effects[-1]

    @property
    def is_fitted(self) -> bool:
        """Whether it was fitted; otherwise its score is that of the score test."""
        return self.name in self.fit.model.effects

    def stored(self) -> Candidate:
        """The candidate without its Jacobian, which later rounds do not use: a search keeps dozens, of up to 100 MB."""
        if not self.is_fitted:
            return self
        return replace(self, fit=replace(self.fit, jacobian=self.fit.jacobian[:0].copy()))


def candidate_names(model: Model, channels: set[str]) -> list[str]:
    """Names of effects that are not in the model and have a parameter that these channels can identify."""
    names = []
    for name, effect in REGISTRY.items():
        usable = [p for p in effect.parameters if p.channel is None or p.channel in channels]
        if usable and name not in model.effects:
            names.append(name)
    return names


@dataclass(frozen=True, eq=False)
class Exploration:
    """All candidates of one round.

    Attributes:
      ranked: the candidates, best first.
      slopes: candidate -> derivatives of the residual.
    """

    ranked: list[Candidate]
    slopes: dict[str, Slopes]


def explore(bench: Workbench, base: Fit, names: Iterable[str], progress: Progress = silent) -> Exploration:
    """Scores each effect beside a fitted model: all by the score test, the best of them by a fit.

    Args:
      bench: the data.
      base: the fit of the model without the candidates.
      names: of the effects.
      progress: called with a message for every effect that is fitted.
    """
    names = list(names)
    progress("scoring the effects")
    peaks = _wave_peaks(bench, base, names)
    slopes = dict(
        zip(
            names,
            bench.pool.map(lambda n: effect_slopes(bench, base, n, peaks.get(n, ())), names),
            strict=True,
        )
    )
    tested = {name: score_test(bench, base, slopes[name]) for name in names}
    best_first = sorted(names, key=lambda name: -tested[name])
    count = int(np.clip(sum(score > 0 for score in tested.values()), CONTENDERS, 2 * CONTENDERS))
    chosen = [
        n
        for k, n in enumerate(best_first)
        if k < count or strained_parameters(base, REGISTRY[n].replaces) or _is_hidden(bench, base, n)
    ]
    scored = list[Candidate]()
    for name in chosen:
        progress(f"trying {labels.words(name)}")
        goal = _cost_of_contenders(scored)
        scored.append(fit_quickly(bench, base, name, slopes[name], peaks.get(name, ()), goal))
    others = [n for n in names if n not in chosen]
    for name, values in _large_sizes(bench, base, {n: slopes[n] for n in others}, scored).items():
        progress(f"trying {labels.words(name)}")
        chosen.append(name)
        scored.append(fit_from_best(bench, base, name, [values], goal=_cost_of_contenders(scored)))
    # A score test may overestimate the gain of a fit: candidates that were not fitted rank behind those that were.
    least = min((c.score for c in scored[:count]), default=0.0)
    for name in names:
        if name not in chosen:
            scored.append(Candidate((*base.model.effects, name), base, min(tested[name], least)))
    return Exploration(sorted(scored, key=lambda c: (-c.score, -tested[c.name])), slopes)


def _cost_of_contenders(fitted: Sequence[Candidate]) -> float:
    """Cost below which a fit has to come to be one of the contenders; infinite while there are fewer of these."""
    costs = sorted(c.fit.cost for c in fitted)
    return costs[CONTENDERS - 1] if len(costs) >= CONTENDERS else np.inf


def _wave_peaks(bench: Workbench, base: Fit, names: Sequence[str]) -> dict[str, tuple[Peak, ...]]:
    """Name -> peaks of its spectrum on driven data, of those of these effects that are a wave."""
    waves = [name for name in names if REGISTRY[name].wave is not None]
    if not waves:
        return {}
    driven, fit = output_error.on_driven_data(bench, base)
    return {name: spectrum.spectral_peaks(driven, fit, REGISTRY[name]) for name in waves}


def _large_sizes(
    bench: Workbench, base: Fit, slopes: Mapping[str, Slopes], fitted: Sequence[Candidate]
) -> dict[str, dict[str, float]]:
    """Name -> parameters of effects that gain much at a size far from neutral, if the fitted candidates gain little.

    The score test fails for an effect that changes the frequencies of the link much: it is linear in the effect. Output
    errors come after a round on driven data, which has tried these; there it is an effect that is not smooth at neutral
    which is tried, if any size of it gains. An effect cannot gain more than the misfit of the blocks that it changes:
    one on the hub alone leaves the strains as they are.
    """
    at_base = bench.cost(base.residual)
    if not isinstance(bench.data, DrivenData):
        rough = {
            n: best_on_rays(bench, base, n, of.reached)
            for n, of in slopes.items()
            if not REGISTRY[n].smooth_at_neutral
        }
        return {name: values for name, (values, cost) in rough.items() if cost < at_base}
    best, misfit = max((c.score for c in fitted), default=0.0), bench.misfit(base.residual)
    # Noise alone has half a nat per independent sample.
    if best > _PROMISING * misfit or misfit < 0.5 * bench.count.sum():
        return {}
    able = [name for name, of in slopes.items() if _reach(bench, base, of.columns) > _PROMISING * best]
    lowest = {
        name: best_on_rays(bench, base, name, slopes[name].reached)
        for name in able
        if REGISTRY[name].wave is None
    }
    return {name: values for name, (values, cost) in lowest.items() if at_base - cost > _PROMISING * best}


def _is_hidden(bench: Workbench, base: Fit, name: str) -> bool:
    """Whether fitted parameters hide an effect in output errors: it is then fitted whatever its score test.

    At neutral its slope is theirs, and what tells it from them comes with its size. On driven data it is clear of them.
    """
    fitted = {u.name for u in base.unknowns if u.kind == "rig"}
    return not isinstance(bench.data, DrivenData) and bool(fitted & REGISTRY[name].hidden_by.keys())


def _reach(bench: Workbench, base: Fit, columns: np.ndarray) -> float:
    """Misfit of the blocks that these changes of the residual (n x k) touch; infinite without changes."""
    if not columns.shape[1]:
        return np.inf
    touched = bench.sizes(np.max(np.abs(columns), axis=1)) > 0
    return float(bench.misfits(base.residual)[touched].sum())


def strained_parameters(base: Fit, names: Sequence[str]) -> bool:
    """Whether the calibration moved one of these declared parameters far from its declared value.

    An effect that replaces it is then fitted whatever its score test: other parameters compensate and stand at their
    bounds, where the linear prediction is poor.
    """
    return any(
        u.kind == "rig" and u.name in names and abs(v - u.start) > STRAIN * u.scale
        for u, v in zip(base.unknowns, base.values, strict=True)
    )


def score_test(bench: Workbench, base: Fit, slopes: Slopes) -> float:
    """Score test of an effect at neutral: the predicted gain in log likelihood less the penalty of its parameters.

    The declared parameters are nuisance parameters: the part of the columns that they can reproduce gains nothing.
    """
    if not slopes.columns.shape[1]:
        return 0.0
    return linear_gain(bench, base, slopes.columns, slopes.replaces) - slopes.penalty


def effect_slopes(bench: Workbench, base: Fit, name: str, peaks: Sequence[Peak] = ()) -> Slopes:
    """Derivatives of the residual at neutral, one along each ray; of a wave, at the highest of these peaks."""
    effect = REGISTRY[name]
    penalised = bench.penalty(len(effect.free_parameters(effect.neutral(base.model.declared))))
    if effect.wave is not None:
        columns: np.ndarray = wave_slopes(bench, base, name, peaks).astype(np.float32)
        comparisons, level = (peaks[0].comparisons, peaks[0].level) if peaks else (1, 1.0)
        return Slopes(columns, tuple(effect.replaces), penalised, comparisons, level)
    neutral = effect.neutral(base.model.declared)
    changes, coefficients, reached = [], [], list[Reached | None]()
    for ray in rays(bench, effect, neutral, base.model):
        length, change = visible_length(bench, base, name, neutral, ray, SLOPE_FACTOR)
        reached.append(None if change is None else (length, size_of(change)))
        if change is not None:
            size = max(float(np.std(change)), ROUNDING)
            changes.append((change / size).astype(np.float32))
            point = point_on_ray(effect, neutral, ray, length)
            coefficients.append(np.array(effect.linear_coefficients(point or neutral)) / size)
    columns = np.column_stack(changes) if changes else np.zeros((len(base.residual), 0))
    linear = np.array(coefficients) if changes else np.zeros((0, 0))
    return Slopes(columns, tuple(effect.replaces), penalised, coefficients=linear, reached=tuple(reached))


def wave_slopes(bench: Workbench, base: Fit, name: str, peaks: Sequence[Peak]) -> np.ndarray:
    """Derivatives (n x k) of the residual by the coefficients of a wave at the highest of some peaks."""
    effect = REGISTRY[name]
    if not peaks:
        return np.zeros((len(base.residual), 0))
    if isinstance(bench.data, DrivenData):
        return spectrum.wave_slopes(bench, base, effect, peaks[0])
    neutral, columns = effect.neutral(base.model.declared), []
    for unit in np.eye(len(peaks[0].coefficients)):
        values = effect.wave_parameters(peaks[0].order, tuple(unit))
        ray = {p.name: values[p.name] - neutral[p.name] for p in effect.parameters}
        _, change = visible_length(bench, base, name, neutral, ray, SLOPE_FACTOR)
        if change is not None:
            columns.append(change / max(float(np.std(change)), ROUNDING))
    return np.column_stack(columns) if columns else np.zeros((len(base.residual), 0))


def fit_quickly(
    bench: Workbench,
    base: Fit,
    name: str,
    slopes: Slopes,
    peaks: Sequence[Peak] = (),
    goal: float = np.inf,
) -> Candidate:
    """Fits an effect with few iterations, from a point off neutral or from the peaks of its wave, up to a `goal`."""
    if peaks:
        return fit_from_best(bench, base, name, points_at_peaks(bench, base, name, peaks), goal=goal)
    values = _point_off_neutral(bench, base, name, slopes)
    starts = [(values, base), *_hidden_starts(base, name)]
    fits = [fit_from_best(bench, base, name, [v], near, goal) for v, near in starts]
    return min(fits, key=lambda c: c.fit.cost)


def _hidden_starts(base: Fit, name: str) -> list[tuple[dict[str, float], Fit]]:
    """Sizes of an effect, and the fit moved by what hides each; none for most effects.

    Declared parameters that were fitted to such an effect have taken its place: with these as they are, every size is
    worse than none. So it takes a share of them.
    """
    effect, fitted = REGISTRY[name], {u.name: v for u, v in zip(base.unknowns, base.values, strict=True)}
    hiding = {k: rate for k, rate in effect.hidden_by.items() if k in fitted}
    most = min((abs(fitted[k] / rate) for k, rate in hiding.items()), default=0.0)
    if most == 0.0:
        return []
    neutral, first = effect.neutral(base.model.declared), effect.parameters[0].name
    sizes = [share * most for share in _HIDDEN_SHARES]
    return [({**neutral, first: w}, _moved(base, {k: v * w for k, v in hiding.items()})) for w in sizes]


def _moved(base: Fit, changes: Mapping[str, float]) -> Fit:
    """A fit with some of its declared parameters changed, within their bounds."""
    values = np.array(
        [
            np.clip(v + changes.get(u.name, 0.0), *u.bounds) if u.kind == "rig" else v
            for u, v in zip(base.unknowns, base.values, strict=True)
        ]
    )
    model, starts = model_and_starts_at(base.model, base.starts, base.unknowns, values)
    return replace(base, model=model, starts=starts, values=values)


def _point_off_neutral(bench: Workbench, base: Fit, name: str, slopes: Slopes) -> dict[str, float]:
    """Parameters from which a fit starts: by linear regression on the slopes if this lowers the cost, else by rays.

    The regression is possible for effects with `Effect.linear_coefficients`. It also gives parameters without a
    derivative at neutral, as the rest angle of a cable: from a wrong one a fit returns to neutral.
    """
    effect = REGISTRY[name]
    if slopes.coefficients.size:
        _, amounts, _ = linear_move(bench, base, slopes.columns, slopes.replaces)
        values = effect.from_linear_coefficients(amounts @ slopes.coefficients)
        if values is not None:
            values = {p.name: float(np.clip(values[p.name], *p.bounds)) for p in effect.parameters}
            [residual] = bench.residuals([(with_effect(base.model, name, values), base.starts, None)])
            if bench.cost(residual) < bench.cost(base.residual):
                return values
    return best_on_rays(bench, base, name, slopes.reached)[0]


def fit_from_best(
    bench: Workbench,
    base: Fit,
    name: str,
    points: Sequence[Mapping[str, float]],
    near: Fit | None = None,
    goal: float = np.inf,
) -> Candidate:
    """The best fit of an effect from these points; the derivatives by declared parameters stay those of `base`.

    All else starts from the values of `near`, by default those of `base`. A fit is given up where its cost would stay
    above `goal` or above that of an earlier one.
    """
    near, errors = near or base, base.model.channel_errors
    first, *others = [with_replaced_errors(name, values, errors) for values in points]
    result = _fit_from(bench, base, name, first, near, goal)

    def better_from(values: Mapping[str, float]) -> Fit:
        again = _fit_from(bench, base, name, values, near, min(goal, result.cost))
        return min(result, again, key=lambda f: f.cost)

    for values in others:
        result = better_from(values)
    # Choices, as which channels are delayed, are compared at the fitted values of the other parameters.
    chosen = _with_best_choices(bench, result, name)
    if chosen != result.model.effects[name]:
        result = better_from(chosen)
    # A round keeps the Jacobians of all its fitted candidates: in single precision they take half the memory.
    single = replace(result, jacobian=result.jacobian.astype(np.float32))
    return Candidate((*base.model.effects, name), single, score_gain(bench, base, result))


def _fit_from(
    bench: Workbench, base: Fit, name: str, values: Mapping[str, float], near: Fit, goal: float
) -> Fit:
    model = without_replaced_errors(with_effect(base.model, name, values))
    unknowns = fit_unknowns(bench, model, base)
    first, known = initial_values(unknowns, model, base, near), base.jacobian_columns
    if REGISTRY[name].delays_readings:
        # The vibration of an unknown initial state comes later, at a few milliseconds with the opposite sign.
        known = {u.key: known[u.key] for u in base.unknowns if u.kind != "start"}
    return minimise(bench, model, base.starts, unknowns, first, known, QUICK_ITERATIONS, goal=goal)


def _with_best_choices(bench: Workbench, fit: Fit, name: str) -> dict[str, float]:
    """The values of an effect with those choices of its starts that have the lowest cost, nothing refitted."""
    effect, values = REGISTRY[name], fit.model.effects[name]
    choices = [p.name for p in effect.parameters if p.choice]
    if not choices:
        return dict(values)
    # Of choices that make no difference, the one at neutral.
    neutral = effect.neutral(fit.model.declared)
    chosen = [{c: s[c] for c in choices} for s in (neutral, values, *effect.starts(fit.model.declared))]
    different = [{**values, **c} for k, c in enumerate(chosen) if c not in chosen[:k]]
    options = [v for v in different if effect.fits(v, fit.model.sensors)] or [dict(values)]
    jobs = [(with_effect(fit.model, name, v), fit.starts, None) for v in options]
    costs = [bench.cost(r) for r in bench.residuals(jobs)]
    return options[int(np.argmin(costs))]


def try_effect(bench: Workbench, base: Fit, name: str) -> Candidate:
    """Adds one effect to a fitted model and fits it with few iterations."""
    peaks = _wave_peaks(bench, base, [name]).get(name, ())
    return fit_quickly(bench, base, name, effect_slopes(bench, base, name, peaks), peaks)


def score_gain(bench: Workbench, base: Fit, result: Fit) -> float:
    """Penalised log-likelihood ratio of a fit and the base: drop of the cost less the penalty of the added parameters.

    The drop counts as 0 if it is negative, or if the size of an added effect is within the tolerance of good sensors
    and cards (`_is_resolved`).
    """
    added = len(result.unknowns) - len(base.unknowns)
    gained = max(base.cost - result.cost, 0.0) if _is_resolved(bench, base, result) else 0.0
    return gained - bench.penalty(added)


def _is_resolved(bench: Workbench, base: Fit, result: Fit) -> bool:
    """Whether every effect that a fit adds exceeds the tolerance of good sensors and cards."""
    period = shortest_period(bench.prepared)
    new = result.model.effects.keys() - base.model.effects.keys()
    return all(REGISTRY[name].is_resolved(result.model.effects[name], period) for name in new)


def points_at_peaks(bench: Workbench, base: Fit, name: str, peaks: Sequence[Peak]) -> list[dict[str, float]]:
    """Parameters at the highest peak of a wave's spectrum, and at the one with the lowest cost if it is another.

    The spectrum lets the declared parameters compensate; the cost here is at their present values.
    """
    effect = REGISTRY[name]
    waves = [effect.wave_parameters(peak.order, peak.coefficients) for peak in peaks]
    points = [{p.name: float(np.clip(v[p.name], *p.bounds)) for p in effect.parameters} for v in waves]
    jobs = [(with_effect(base.model, name, p), base.starts, None) for p in points]
    best = int(np.argmin([bench.cost(r) for r in bench.residuals(jobs)]))
    return [points[k] for k in sorted({0, best})]
