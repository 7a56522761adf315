"""Effects fitted to where a rig came to rest: a few angles with their spread, and no time histories.

Where the hub sticks depends on the phase in which friction catches the ringing link, so an angle of rest jumps as
a parameter grows and has no useful slope: each fit draws many points within the bounds of its parameters and
follows the best downhill without slopes (Nelder and Mead).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from open_loop import Profile, turn
from scipy.optimize import minimize
from scipy.stats import chi2

from twin.effects import REGISTRY, Effect, EffectParameter
from twin.rigs.model import Model

Effects = Mapping[str, Mapping[str, float]]

SIGNIFICANCE = 0.05
"""Probability with which a true explanation would be turned down."""
_LARGEST = math.radians(1e4)  # stands for the turn of a run that does not end anywhere
_FACTOR = 10.0  # by which a declared value may be off
_VISIBLE = 1e-5  # rad
_WIDE = 30.0  # a range of positive values wider than this is drawn by its logarithm


@dataclass(frozen=True)
class Outcomes:
    """What a series of runs came to.

    Attributes:
      profiles: the commands (m).
      mean, spread: (m) turn of the hub and its standard deviation [rad].
    """

    profiles: tuple[Profile, ...]
    mean: np.ndarray
    spread: np.ndarray

    def only(self, kept: Sequence[int]) -> Outcomes:
        """Returns some of the runs."""
        rows = list(kept)
        return Outcomes(tuple(self.profiles[k] for k in rows), self.mean[rows], self.spread[rows])

    def misfit(self, turns: np.ndarray) -> float:
        """Returns chi-squared of predicted turns (m) [rad]."""
        return float(np.sum(((turns - self.mean) / self.spread) ** 2))


@dataclass(frozen=True)
class TurnFit:
    """Effects at their best.

    Attributes:
      effects: name -> parameters, SI.
      turns: (m) predicted [rad].
      misfit: chi-squared.
      free: how many numbers were fitted.
    """

    effects: Effects
    turns: np.ndarray
    misfit: float
    free: int

    @property
    def degrees_of_freedom(self) -> int:
        """Runs left over for a test."""
        return len(self.turns) - self.free

    @property
    def probability(self) -> float:
        """Probability of a misfit this large or larger if this is the truth; nan where nothing is left to test it."""
        left = self.degrees_of_freedom
        return float(chi2.sf(self.misfit, left)) if left > 0 else math.nan

    @property
    def passes(self) -> bool:
        """Whether the runs do not turn it down, and could have."""
        return self.probability >= SIGNIFICANCE


def turns(model: Model, profiles: Sequence[Profile]) -> np.ndarray:
    """Returns the turn of each run (m) [rad]; a run that diverges counts as a very large one."""
    found = np.array([turn(model, profile) for profile in profiles])
    return np.clip(np.nan_to_num(found, nan=_LARGEST, posinf=_LARGEST, neginf=-_LARGEST), -_LARGEST, _LARGEST)


@dataclass(frozen=True)
class Free:
    """One number that a fit moves.

    Attributes:
      owner: name of an effect, or "rig" for a declared parameter.
      name: of the parameter.
      neutral: number from which a search starts.
      bounds: range.
      step: a small but visible size.
      along: whether it only says where or how the effect acts: it is drawn from its whole range.
      inverse: whether the number is one over the parameter's value.
      turns_over: whether it is an angle that repeats.
    """

    owner: str
    name: str
    neutral: float
    bounds: tuple[float, float]
    step: float
    along: bool = False
    inverse: bool = False
    turns_over: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """Returns a random value; about neutral, distances of every order of magnitude."""
        low, high = self.bounds
        if self.turns_over:
            return float(rng.uniform(max(low, -math.pi), min(high, math.pi)))
        if self.along:
            wide = low > 0 and high > _WIDE * low
            return float(np.exp(rng.uniform(*np.log(self.bounds)))) if wide else float(rng.uniform(low, high))
        sides = [end - self.neutral for end in self.bounds if abs(end - self.neutral) > abs(self.step)]
        far = float(rng.choice(sides))
        distance = math.exp(rng.uniform(math.log(abs(self.step)), math.log(abs(far))))
        return self.neutral + math.copysign(distance, far)


def free_parameters(model: Model, effect: str) -> tuple[Free, ...]:
    """Returns the parameters of an effect that the turn of the hub can say something about.

    Torques stay within the motor's own: a friction level beyond it holds the hub for good. Declared values stay
    within a factor of ten.
    """
    neutral = REGISTRY[effect].neutral(model.declared)
    seen = [p for p in REGISTRY[effect].free_parameters(neutral) if p.channel in (None, "hub_angle")]
    limit = model.declared["torque_limit"]
    return tuple(_free(REGISTRY[effect], p, neutral[p.name], limit) for p in seen)


def _free(effect: Effect, p: EffectParameter, neutral: float, limit: float) -> Free:
    low, high = p.span
    bounds = (low, high)
    if p.unit == "N*m":
        bounds = (max(low, -limit), min(high, limit))
    elif p.neutral is None:
        bounds = (max(low, neutral / _FACTOR), min(high, neutral * _FACTOR))
    along = p.name in effect.undefined_at_neutral
    repeats = along and p.unit == "rad"
    return Free(effect.name, p.name, p.turned(neutral), bounds, p.step, along, p.inverse, repeats)


def declared(model: Model, *names: str) -> tuple[Free, ...]:
    """Returns declared parameters of the rig as free numbers; bounds as in `free_parameters`."""
    rows = [model.declared.parameters[name] for name in names]
    limit = model.declared["torque_limit"]
    ends = [limit if r.unit == "N*m" else math.inf for r in rows]
    bounds = [(r.bounds[0], min(r.bounds[1], end)) for r, end in zip(rows, ends, strict=True)]
    return tuple(Free("rig", r.name, r.value, b, 0.05 * r.value) for r, b in zip(rows, bounds, strict=True))


def with_values(model: Model, free: Sequence[Free], values: ArrayLike) -> Model:
    """Returns the model with these numbers in the place of its own."""
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
    """How long to look, per free parameter: points drawn at first, best ones followed, steps of each.

    Attributes:
      draws: points drawn for each free parameter.
      follow: how many of the best are followed.
      steps: simulations of the series that each may take, per free parameter.
      seed: of the draws.
      worth: misfit up to which a drawn point is followed.
    """

    draws: int = 80
    follow: int = 2
    steps: int = 40
    seed: int = 1
    worth: float = math.inf


def acts(model: Model, free: Sequence[Free], profiles: Sequence[Profile], draws: int = 5) -> bool:
    """Whether any of these numbers changes where the hub comes to rest."""
    rng, before = np.random.default_rng(0), turns(model, profiles)
    points = [[f.draw(rng) for f in free] for _ in range(draws if free else 0)]
    return any(
        np.any(np.abs(turns(with_values(model, free, x), profiles) - before) > _VISIBLE) for x in points
    )


def fit(model: Model, free: Sequence[Free], outcomes: Outcomes, search: Search | None = None) -> TurnFit:
    """Fits the numbers in `free` to the outcomes; without any, predicts."""
    search = search or Search()

    def misfit(x: np.ndarray, ceiling: float = math.inf) -> float:
        return _misfit(with_values(model, free, x), outcomes, ceiling)

    best = np.array([f.neutral for f in free])
    if free:
        best = _lowest(misfit, free, search)
    fitted = with_values(model, free, best)
    found = turns(fitted, outcomes.profiles)
    values = {f.name: fitted.declared[f.name] for f in free if f.owner == "rig"}
    effects = {**({"rig": values} if values else {}), **fitted.effects}
    return TurnFit(effects, found, outcomes.misfit(found), len(free))


def _misfit(model: Model, outcomes: Outcomes, ceiling: float) -> float:
    """Chi-squared of a model; the later runs are left out once it is above `ceiling`."""
    total = 0.0
    for k in range(len(outcomes.profiles)):
        one = outcomes.only([k])
        total += one.misfit(turns(model, one.profiles))
        if total > ceiling:
            break
    return total


def _drawn(
    misfit: Callable[[np.ndarray, float], float], free: Sequence[Free], search: Search
) -> list[tuple[float, np.ndarray]]:
    """Best points of a random draw and the neutral one, with their misfits, best first."""
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


def _lowest(misfit: Callable[..., float], free: Sequence[Free], search: Search) -> np.ndarray:
    """Returns the point with the least misfit found."""
    results = _drawn(misfit, free, search)
    for point in [x for cost, x in results if cost <= search.worth]:
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


def _simplex(x: np.ndarray, free: Sequence[Free]) -> np.ndarray:
    """A point and one more for each number, a fifth of its distance from neutral further."""
    corners = np.tile(x, (len(free) + 1, 1))
    for i, f in enumerate(free):
        size = 0.3 if f.turns_over else max(abs(f.step), 0.2 * abs(x[i] - f.neutral))
        inside = x[i] + size <= f.bounds[1]
        corners[i + 1, i] = np.clip(x[i] + (size if inside else -size), *f.bounds)
    return corners
