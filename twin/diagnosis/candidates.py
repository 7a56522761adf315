"""Calibration, and the search for the effect that the model lacks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.diagnosis import spectrum
from twin.diagnosis.chance import Slopes
from twin.diagnosis.spectrum import Peak
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.slopes import linear_gain, linear_move
from twin.estimation.unknowns import Unknown, effect_unknowns, replaced_parameters
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent
from twin.residuals.prepared import shortest_period
from twin.rigs.model import Model

_FITTED, _ANYWAY = 6, 3  # effects that are fitted at most, of those that promise anything, and at least
_STRAINED = 2.0  # standard deviations from its declared value at which a parameter makes one think
_STRAIGHT = 15.0  # times more or less than that may a change be from which a slope is taken
_MUCH = 0.4  # share of the misfit that one effect among several explains
_PROMISING = 0.5  # share of the best score that a size alone, nothing fitted, has to gain to be fitted
_OFF = 0.5  # misfit a sample from which a model is off in most of what was recorded, not only here and there
_QUICK = 8  # iterations of a first fit
_VISIBLE = 1.0  # rms change of the residual in noise levels from which an effect is followed outwards


@dataclass(frozen=True, eq=False)
class Candidate:
    """One set of effects, fitted.

    Attributes:
      effects: their names, in the order of adoption.
      fit: the fit.
      score: what it gains in cost over the model it was added to, less the price of its parameters.
    """

    effects: tuple[str, ...]
    fit: Fit
    score: float

    @property
    def name(self) -> str:
        """The effect that was added last."""
        return self.effects[-1]

    @property
    def is_fitted(self) -> bool:
        """Whether it was fitted: else its score is what its slopes promise."""
        return self.name in self.fit.model.effects


def price(parameters: int, bench: Workbench) -> float:
    """Price of parameters in cost: half a log of the number of pieces of evidence each (Schwarz criterion)."""
    return 0.5 * parameters * float(np.log(max(bench.count.sum(), 2.0)))


def candidates(model: Model, seen: set[str]) -> list[str]:
    """Effects that could be missing and of which these channels can say something."""
    names = []
    for name, effect in REGISTRY.items():
        usable = [p for p in effect.parameters if p.channel is None or p.channel in seen]
        if usable and name not in model.effects:
            names.append(name)
    return names


@dataclass(frozen=True, eq=False)
class Explored:
    """What one round of the search came to.

    Attributes:
      ranked: the candidates, best first.
      slopes: what each promised to first order.
    """

    ranked: list[Candidate]
    slopes: dict[str, Slopes]


def explore(bench: Workbench, base: Fit, names: Iterable[str], progress: Progress = silent) -> Explored:
    """Each effect added to a fitted model, best first: all by their slopes, the most promising by a fit."""
    names = list(names)
    progress("scoring the effects")
    tops = {
        name: spectrum.spectral_peaks(bench, base, REGISTRY[name])
        for name in names
        if REGISTRY[name].wave is not None
    }
    slopes = {name: slopes_of(bench, base, name, tops.get(name, ())) for name in names}
    promise = {name: score_test(bench, base, slopes[name]) for name in names}
    best_first = sorted(names, key=lambda name: -promise[name])
    count = int(np.clip(sum(score > 0 for score in promise.values()), _ANYWAY, _FITTED))
    chosen = [
        n for k, n in enumerate(best_first) if k < count or strained_parameters(base, REGISTRY[n].replaces)
    ]
    found = []
    for name in chosen:
        progress(f"trying {name}")
        found.append(fit_quickly(bench, base, name, slopes[name], tops.get(name, ())))
    for name, values in _far_off(bench, base, [n for n in names if n not in chosen], found).items():
        progress(f"trying {name}")
        chosen.append(name)
        found.append(fit_from_best(bench, base, name, [values]))
    # A slope promises no more than what a fit delivers.
    least = min((c.score for c in found[:count]), default=0.0)
    for name in names:
        if name not in chosen:
            found.append(Candidate((*base.model.effects, name), base, min(promise[name], least)))
    return Explored(sorted(found, key=lambda c: (-c.score, -promise[c.name])), slopes)


def _far_off(
    bench: Workbench, base: Fit, names: Sequence[str], found: Sequence[Candidate]
) -> dict[str, dict[str, float]]:
    """Effects that explain much at a size far from neutral, with it, where the others that were tried explain little.

    A slope at neutral says nothing of an effect that takes the link to quite another frequency.
    """
    best, left = max((c.score for c in found), default=0.0), bench.misfit(base.residual)
    if best > _MUCH * left or left < _OFF * bench.count.sum():
        return {}
    reached = {name: best_on_rays(bench, base, name) for name in names if REGISTRY[name].wave is None}
    at_base = bench.cost(base.residual)
    return {name: values for name, (values, cost) in reached.items() if at_base - cost > _PROMISING * best}


def strained_parameters(base: Fit, names: Sequence[str]) -> bool:
    """Whether one of these declared parameters is far from what was declared: freeing it may do more than slopes say.

    Others bend with it to the ends of their ranges, from where the way to the truth is no straight line.
    """
    return any(
        u.kind == "rig" and u.name in names and abs(v - u.start) > _STRAINED * u.scale
        for u, v in zip(base.unknowns, base.values, strict=True)
    )


def score_test(bench: Workbench, base: Fit, slopes: Slopes) -> float:
    """Gain that the slopes of an effect at neutral promise: a score test, less the price of its parameters.

    The effect's columns compete with the declared parameters: what these can do as well is no gain.
    """
    if not slopes.columns.shape[1]:
        return 0.0
    return linear_gain(bench, base, slopes.columns, slopes.replaces) - slopes.price


def slopes_of(bench: Workbench, base: Fit, name: str, tops: Sequence[Peak] = ()) -> Slopes:
    """Slopes of an effect at neutral; of a wave, at the highest peak of its spectrum."""
    effect = REGISTRY[name]
    paid = price(len(effect.free(effect.neutral(base.model.declared))), bench)
    if effect.wave is not None:
        columns = (
            spectrum.wave_slopes(bench, base, effect, tops[0]) if tops else np.zeros((len(base.residual), 0))
        )
        rivals, level = (tops[0].rivals, tops[0].level) if tops else (1, 1.0)
        return Slopes(columns, tuple(effect.replaces), paid, rivals, level)
    neutral = effect.neutral(base.model.declared)
    changes, coefficients = [], []
    for ray in rays(bench, effect, neutral, base.model):
        length, change = visible_length(bench, base, name, neutral, ray, _STRAIGHT)
        if change is not None:
            size = max(float(np.std(change)), 1e-12)
            changes.append(change / size)
            point = _on_ray(effect, neutral, ray, length)
            coefficients.append(np.array(effect.linear(point or neutral)) / size)
    columns = np.column_stack(changes) if changes else np.zeros((len(base.residual), 0))
    linear = np.array(coefficients) if changes else np.zeros((0, 0))
    return Slopes(columns, tuple(effect.replaces), paid, coefficients=linear)


def fit_quickly(
    bench: Workbench, base: Fit, name: str, slopes: Slopes, tops: Sequence[Peak] = ()
) -> Candidate:
    """Follows an effect out of its neutral value, or to the peaks of its wave, and fits it."""
    points = at_peaks(bench, base, name, tops) if tops else [_outside(bench, base, name, slopes)]
    return fit_from_best(bench, base, name, points)


def _outside(bench: Workbench, base: Fit, name: str, slopes: Slopes) -> dict[str, float]:
    """Where to start from away from neutral: where slopes lead, if that is better than neutral, or the best on rays.

    Where a force comes from, as a cable's rest angle, has no slope at neutral, and a fit from a wrong one goes back.
    """
    effect = REGISTRY[name]
    if slopes.coefficients.size:
        _, amounts = linear_move(bench, base, slopes.columns, slopes.replaces)
        led = effect.of_linear(amounts @ slopes.coefficients)
        if led is not None:
            led = {p.name: float(np.clip(led[p.name], *p.bounds)) for p in effect.parameters}
            [residual] = bench.residuals([(with_effect(base.model, name, led), base.starts, None)])
            if bench.cost(residual) < bench.cost(base.residual):
                return led
    return best_on_rays(bench, base, name)[0]


def fit_from_best(bench: Workbench, base: Fit, name: str, points: Sequence[Mapping[str, float]]) -> Candidate:
    """Fits an effect from the best of these points, with the declared parameters' slopes kept."""
    result = min((_quickly(bench, base, name, values) for values in points), key=lambda f: f.cost)
    # Which channels are late can be told only where it is known how late they are.
    chosen = _best_choice(bench, result, name)
    if chosen != result.model.effects[name]:
        result = min(result, _quickly(bench, base, name, chosen), key=lambda f: f.cost)
    return Candidate((*base.model.effects, name), result, score_gain(bench, base, result))


def _quickly(bench: Workbench, base: Fit, name: str, values: Mapping[str, float]) -> Fit:
    model = with_effect(base.model, name, values)
    unknowns = unknowns_of(bench, model, base)
    first = first_values(unknowns, model, base)
    return minimise(bench, model, base.starts, unknowns, first, base.jacobian_columns, _QUICK)


def _best_choice(bench: Workbench, found: Fit, name: str) -> dict[str, float]:
    """The values of an effect, its choices those of its starts that fit best as it stands."""
    effect, values = REGISTRY[name], found.model.effects[name]
    choices = [p.name for p in effect.parameters if p.choice]
    if not choices:
        return dict(values)
    ways = [{**values, **{c: s[c] for c in choices}} for s in effect.starts(found.model.declared)]
    jobs = [(with_effect(found.model, name, way), found.starts, None) for way in (dict(values), *ways)]
    costs = [bench.cost(r) for r in bench.residuals(jobs)]
    return (dict(values), *ways)[int(np.argmin(costs))]


def try_effect(bench: Workbench, base: Fit, name: str) -> Candidate:
    """One effect added to a fitted model, followed out of its neutral value or from its spectrum, and fitted."""
    effect = REGISTRY[name]
    tops = spectrum.spectral_peaks(bench, base, effect) if effect.wave is not None else ()
    return fit_quickly(bench, base, name, slopes_of(bench, base, name, tops), tops)


def score_gain(bench: Workbench, base: Fit, result: Fit) -> float:
    """Cost gained, less the price of the parameters added; at neutral nothing is lost but that.

    What is less than good sensors and cards leave open, a delay or a gain, is no discovery, and gains nothing.
    """
    added = len(result.unknowns) - len(base.unknowns)
    gained = max(base.cost - result.cost, 0.0) if is_resolved(bench, base, result) else 0.0
    return gained - price(added, bench)


def is_resolved(bench: Workbench, base: Fit, result: Fit) -> bool:
    """Whether the effects that a fit adds are larger than what good sensors and cards leave open."""
    period = shortest_period(bench.prepared)
    new = result.model.effects.keys() - base.model.effects.keys()
    return all(REGISTRY[name].resolved(result.model.effects[name], period) for name in new)


def with_effect(model: Model, name: str, values: Mapping[str, float]) -> Model:
    """The model with an effect added or moved."""
    return model.replace(effects={**model.effects, name: dict(values)})


def unknowns_of(bench: Workbench, model: Model, base: Fit) -> tuple[Unknown, ...]:
    """What a fit of this model may move: declared parameters that no effect replaces, effects, first states."""
    replaced = replaced_parameters(model)
    kept = [u for u in base.unknowns if u.kind == "rig" and u.name not in replaced]
    kept += [u for u in base.unknowns if u.kind == "clock"]
    starts = [u for u in base.unknowns if u.kind == "start"]
    effects = [
        u for name, values in model.effects.items() for u in effect_unknowns(name, values, bench.channels())
    ]
    return (*kept, *effects, *starts)


def first_values(unknowns: Sequence[Unknown], model: Model, *fits: Fit) -> np.ndarray:
    """Where the fit of a model starts: the values of the last of these fits that has them, and the effects' own."""
    known = {u.key: v for f in fits for u, v in zip(f.unknowns, f.values, strict=True)}
    first = []
    for u in unknowns:
        value = known.get(u.key, u.start)
        first.append(u.turned(model.effects[u.effect][u.name]) if u.effect in model.effects else value)
    return np.array(first)


def best_on_rays(bench: Workbench, base: Fit, name: str) -> tuple[dict[str, float], float]:
    """The best point on rays from neutral, and its cost: each parameter of the effect alone, and its own starts."""
    effect = REGISTRY[name]
    neutral = effect.neutral(base.model.declared)
    best, best_cost = neutral, np.inf
    for ray in rays(bench, effect, neutral, base.model):
        step, _ = visible_length(bench, base, name, neutral, ray)
        points = [
            _on_ray(effect, neutral, ray, sign * step * multiple)
            for multiple in effect.multiples
            for sign in (1, -1)
        ]
        points = [p for p in points if p is not None]
        if not points:
            continue
        jobs = [(with_effect(base.model, name, p), base.starts, None) for p in points]
        cost = [bench.cost(r) for r in bench.residuals(jobs)]
        if min(cost) < best_cost:
            best, best_cost = points[int(np.argmin(cost))], min(cost)
    return best, best_cost


def at_peaks(bench: Workbench, base: Fit, name: str, tops: Sequence[Peak]) -> list[dict[str, float]]:
    """Where to start from among a wave's peaks: the highest, and that which fits best as it stands, if it is another.

    Declared parameters have bent to what is missing, and as they stand the highest may fit worse than none.
    """
    effect = REGISTRY[name]
    found = [effect.at_order(top.order, top.coefficients) for top in tops]
    points = [{p.name: float(np.clip(v[p.name], *p.bounds)) for p in effect.parameters} for v in found]
    jobs = [(with_effect(base.model, name, p), base.starts, None) for p in points]
    best = int(np.argmin([bench.cost(r) for r in bench.residuals(jobs)]))
    return [points[k] for k in sorted({0, best})]


def rays(bench: Workbench, effect, neutral: Mapping[str, float], model: Model) -> list[dict[str, float]]:
    """Directions out of neutral, as increments of the parameters."""
    seen = bench.channels()
    usable = [p for p in effect.parameters if p.channel is None or p.channel in seen]
    turn = {p.name: p.turned for p in effect.parameters}
    own = [
        {k: turn[k](v) - turn[k](neutral[k]) for k, v in start.items()}
        for start in effect.starts(model.declared)
    ]
    single = [{p.name: p.step} for p in usable] if len(usable) > 1 and not effect.joint else []
    return own + single


def visible_length(
    bench: Workbench,
    base: Fit,
    name: str,
    neutral: Mapping[str, float],
    ray: Mapping[str, float],
    factor_of: float = 3.0,
) -> tuple[float, np.ndarray | None]:
    """Length along the ray at which the residual changes visibly, within a factor, and the change (n) last seen."""
    length, change = 1.0, None
    for _ in range(4):
        forward = _on_ray(REGISTRY[name], neutral, ray, length)
        point = forward or _on_ray(REGISTRY[name], neutral, ray, -length)
        if point is None:
            return length, change
        [r] = bench.residuals([(with_effect(base.model, name, point), base.starts, None)])
        change = (r - base.residual) * (1.0 if forward else -1.0)
        factor = float(np.clip(_VISIBLE / max(np.sqrt(np.mean(change**2)), 1e-9), 1e-3, 1e3))
        if 1 / factor_of < factor < factor_of:
            break
        length *= factor
    return length, change


def _on_ray(effect, neutral: Mapping[str, float], ray: Mapping[str, float], length: float):
    """The point at a length along the ray; None where it leaves the range of a parameter."""
    point = dict(neutral)
    for p in effect.parameters:
        if p.name not in ray:
            continue
        moved = ray[p.name] if p.name in effect.along else ray[p.name] * length
        value = p.turned(neutral[p.name]) + moved
        if not p.span[0] <= value <= p.span[1]:
            return None
        point[p.name] = p.turned(value)
    return point
