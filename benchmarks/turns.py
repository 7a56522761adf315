"""Effects fitted to angles of rest with their standard deviations, without time histories.

The angle at which the hub sticks depends on the phase of the vibrating link, so that it is a discontinuous function of
the parameters without useful derivatives: each fit draws many points within the bounds of its parameters and improves
the best by the simplex method of Nelder and Mead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from open_loop import Profile, final_turn
from scipy.optimize import minimize
from scipy.stats import chi2

from twin.effects import REGISTRY, Effect, EffectParameter
from twin.rigs.model import Model

Effects = Mapping[str, Mapping[str, float]]

SIGNIFICANCE = 0.05
"""Probability with which a true explanation is rejected."""
_DIVERGED = math.radians(1e4)  # turn that a diverging run counts as [rad]
_MAX_FACTOR = 10.0  # by which a fitted parameter may differ from its declared value
_MIN_CHANGE = 1e-5  # rad, change of a turn that counts
_LOG_RANGE = 30.0  # ratio of the bounds above which a positive parameter is drawn log-uniformly


@dataclass(frozen=True)
class MeasuredTurns:
    """Measured turns of m runs.

    Attributes:
      profiles: (m) commands.
      mean, spread: (m) turn of the hub and its standard deviation [rad].
    """

    profiles: tuple[Profile, ...]
    mean: np.ndarray
    spread: np.ndarray

    def only(self, kept: Sequence[int]) -> MeasuredTurns:
        """Returns the runs with these indices."""
        rows = list(kept)
        return MeasuredTurns(tuple(self.profiles[k] for k in rows), self.mean[rows], self.spread[rows])

    def misfit(self, turns: np.ndarray) -> float:
        """Returns chi-squared of predicted turns (m) [rad]."""
        return float(np.sum(((turns - self.mean) / self.spread) ** 2))


@dataclass(frozen=True)
class TurnFit:
    """A fit of effects.

    Attributes:
      effects: name -> parameters, SI; "rig" for declared parameters.
      turns: (m) predicted [rad].
      misfit: chi-squared.
      free: number of fitted parameters.
    """

    effects: Effects
    turns: np.ndarray
    misfit: float
    free: int

    @property
    def degrees_of_freedom(self) -> int:
        """Runs less fitted parameters."""
        return len(self.turns) - self.free

    @property
    def probability(self) -> float:
        """p-value of the misfit; NaN without a degree of freedom."""
        left = self.degrees_of_freedom
        return float(chi2.sf(self.misfit, left)) if left > 0 else math.nan

    @property
    def passes(self) -> bool:
        """Whether the chi-squared test accepts the fit; false without a degree of freedom."""
        return self.probability >= SIGNIFICANCE


def final_turns(model: Model, profiles: Sequence[Profile]) -> np.ndarray:
    """Returns the turn of each run (m) [rad]; a diverging run counts as a very large turn."""
    found = np.array([final_turn(model, profile) for profile in profiles])
    return np.clip(
        np.nan_to_num(found, nan=_DIVERGED, posinf=_DIVERGED, neginf=-_DIVERGED), -_DIVERGED, _DIVERGED
    )


@dataclass(frozen=True)
class FreeParameter:
    """One fitted parameter.

    Attributes:
      owner: name of an effect, or "rig" for a declared parameter.
      name: of the parameter.
      neutral: value from which a search starts.
      bounds: range.
      step: a small change with a visible effect.
      along: whether it determines where or how the effect acts, not how strongly: it is drawn from its whole range.
      inverse: whether the fit changes the inverse of the parameter.
      periodic: whether it is an angle that repeats.
    """

    owner: str
    name: str
    neutral: float
    bounds: tuple[float, float]
    step: float
    along: bool = False
    inverse: bool = False
    periodic: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """Returns a random value; its distance from neutral is log-uniform, unless the parameter is `along`."""
        low, high = self.bounds
        if self.periodic:
            return float(rng.uniform(max(low, -math.pi), min(high, math.pi)))
        if self.along:
            wide = low > 0 and high > _LOG_RANGE * low
            return float(np.exp(rng.uniform(*np.log(self.bounds)))) if wide else float(rng.uniform(low, high))
        sides = [end - self.neutral for end in self.bounds if abs(end - self.neutral) > abs(self.step)]
        far = float(rng.choice(sides))
        distance = math.exp(rng.uniform(math.log(abs(self.step)), math.log(abs(far))))
        return self.neutral + math.copysign(distance, far)


def free_parameters(model: Model, effect: str) -> tuple[FreeParameter, ...]:
    """Returns the parameters of an effect that the turn of the hub may depend on.

    Torques are limited to the motor's: with a larger friction level the hub never moves. Declared values are limited to
    a factor of ten.
    """
    neutral = REGISTRY[effect].neutral(model.declared)
    seen = [p for p in REGISTRY[effect].free_parameters(neutral) if p.channel in (None, "hub_angle")]
    limit = model.declared["torque_limit"]
    return tuple(_free(REGISTRY[effect], p, neutral[p.name], limit) for p in seen)


def _free(effect: Effect, p: EffectParameter, neutral: float, limit: float) -> FreeParameter:
    low, high = p.span
    bounds = (low, high)
    if p.unit == "N*m":
        bounds = (max(low, -limit), min(high, limit))
    elif p.neutral is None:
        bounds = (max(low, neutral / _MAX_FACTOR), min(high, neutral * _MAX_FACTOR))
    along = p.name in effect.undefined_at_neutral
    repeats = along and p.unit == "rad"
    return FreeParameter(effect.name, p.name, p.turned(neutral), bounds, p.step, along, p.inverse, repeats)


def declared_parameters(model: Model, *names: str) -> tuple[FreeParameter, ...]:
    """Returns declared parameters of the rig as fit parameters; bounds as in `free_parameters`."""
    rows = [model.declared.parameters[name] for name in names]
    limit = model.declared["torque_limit"]
    ends = [limit if r.unit == "N*m" else math.inf for r in rows]
    bounds = [(r.bounds[0], min(r.bounds[1], end)) for r, end in zip(rows, ends, strict=True)]
    return tuple(
        FreeParameter("rig", r.name, r.value, b, 0.05 * r.value) for r, b in zip(rows, bounds, strict=True)
    )


def with_parameters(model: Model, free: Sequence[FreeParameter], values: ArrayLike) -> Model:
    """Returns the model with these values of fit parameters."""
    numbers = [float(value) for value in np.asarray(values, dtype=float)]
    rig = model.declared
    for f, value in zip(free, numbers, strict=True):
        if f.owner == "rig":
            rig = rig.replace("fitted to where the hub came to rest", **{f.name: value})
    effects = {name: dict(p) for name, p in model.effects.items()}
    for f, value in zip(free, numbers, strict=True):
        if f.owner != "rig":
            effect = effects.setdefault(f.owner, REGISTRY[f.owner].neutral(model.declared))
            effect[f.name] = (1 / value if value else math.inf) if f.inverse else value
    return model.replace(declared=rig, effects=effects)


@dataclass(frozen=True)
class Search:
    """Extent of a search.

    Attributes:
      draws: random points per free parameter.
      follow: number of the best points from which the simplex method starts.
      steps: simulations of all runs in each simplex search, per free parameter.
      seed: of the random points.
      max_start_misfit: chi-squared up to which a point is a start.
    """

    draws: int = 80
    follow: int = 2
    steps: int = 40
    seed: int = 1
    max_start_misfit: float = math.inf


def changes_turns(
    model: Model, free: Sequence[FreeParameter], profiles: Sequence[Profile], draws: int = 5
) -> bool:
    """Whether any of these parameters changes the angle at which the hub comes to rest."""
    rng, before = np.random.default_rng(0), final_turns(model, profiles)
    points = [[f.draw(rng) for f in free] for _ in range(draws if free else 0)]
    return any(
        np.any(np.abs(final_turns(with_parameters(model, free, x), profiles) - before) > _MIN_CHANGE)
        for x in points
    )


def fit(
    model: Model, free: Sequence[FreeParameter], outcomes: MeasuredTurns, search: Search | None = None
) -> TurnFit:
    """Fits parameters to the measured turns; without any parameter, predicts the turns."""
    search = search or Search()

    def misfit(x: np.ndarray, ceiling: float = math.inf) -> float:
        return _misfit(with_parameters(model, free, x), outcomes, ceiling)

    best = np.array([f.neutral for f in free])
    if free:
        best = _minimised(misfit, free, search)
    fitted = with_parameters(model, free, best)
    found = final_turns(fitted, outcomes.profiles)
    values = {f.name: fitted.declared[f.name] for f in free if f.owner == "rig"}
    effects = {**({"rig": values} if values else {}), **fitted.effects}
    return TurnFit(effects, found, outcomes.misfit(found), len(free))


def _misfit(model: Model, outcomes: MeasuredTurns, ceiling: float) -> float:
    """Chi-squared of a model; later runs are not simulated once it exceeds `ceiling`."""
    total = 0.0
    for k in range(len(outcomes.profiles)):
        one = outcomes.only([k])
        total += one.misfit(final_turns(model, one.profiles))
        if total > ceiling:
            break
    return total


def _best_draws(
    misfit: Callable[[np.ndarray, float], float], free: Sequence[FreeParameter], search: Search
) -> list[tuple[float, np.ndarray]]:
    """The best of the neutral and the random points, with their misfits, best first."""
    rng = np.random.default_rng(search.seed)
    points = [np.array([f.neutral for f in free])]
    points += [np.array([f.draw(rng) for f in free]) for _ in range(search.draws * len(free))]
    best: list[tuple[float, np.ndarray]] = []
    for x in points:
        ceiling = best[-1][0] if len(best) == search.follow else math.inf
        cost = misfit(x, ceiling)
        if cost < ceiling:
            best = sorted([*best, (cost, x)], key=lambda pair: pair[0])[: search.follow]
    return best


def _minimised(misfit: Callable[..., float], free: Sequence[FreeParameter], search: Search) -> np.ndarray:
    """Returns the point with the least misfit that the search finds."""
    results = _best_draws(misfit, free, search)
    for point in [x for cost, x in results if cost <= search.max_start_misfit]:
        found = minimize(
            misfit,
            point,
            method="Nelder-Mead",
            bounds=[f.bounds for f in free],
            options={
                "maxfev": search.steps * len(free),
                "initial_simplex": _simplex(point, free),
                "fatol": 1e-2,
                "xatol": np.inf,
            },
        )
        results.append((float(found.fun), found.x))
    return min(results, key=lambda r: r[0])[1]


def _simplex(x: np.ndarray, free: Sequence[FreeParameter]) -> np.ndarray:
    """Initial simplex: a point, and one for each parameter with a fifth more distance from neutral."""
    corners = np.tile(x, (len(free) + 1, 1))
    for i, f in enumerate(free):
        size = 0.3 if f.periodic else max(abs(f.step), 0.2 * abs(x[i] - f.neutral))
        inside = x[i] + size <= f.bounds[1]
        corners[i + 1, i] = np.clip(x[i] + (size if inside else -size), *f.bounds)
    return corners
