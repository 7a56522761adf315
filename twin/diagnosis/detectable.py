"""What recordings can show: how large each effect has to be before its trace in them exceeds what chance gives.

Nothing is fitted: the declared model, linearised at its declared values. An effect of size s, measured in the standard
errors of that size beside all declared parameters, gains s^2 / 2 in log likelihood, and a diagnosis adopts nothing that
gains less than the score of the model's own error and the penalty of its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.diagnosis import rules
from twin.diagnosis.candidates import SLOPE_FACTOR, candidate_names
from twin.diagnosis.rays import point_on_ray, rays, visible_length
from twin.effects import REGISTRY, Effect, EffectParameter
from twin.estimation.calibrate import declared_fit
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.slopes import kept_beside, normal_equations_at, root_diagonal, row_weights
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent
from twin.residuals.prepared import shortest_period

_ROUNDING = 1e-9
"""Share of a column, squared, below which what the declared parameters leave of it is rounding [1]."""
_LONGER = 1.25  # ratio of the lengths along a ray at which the tolerance of good sensors is tried


@dataclass(frozen=True)
class Detectable:
    """How well recordings determine one parameter of an effect near its neutral value.

    Attributes:
      effect, parameter: names.
      unit: of the parameter, SI.
      neutral: value at which the effect does nothing; may be infinite.
      sigma: standard error of its distance from neutral in the least visible direction of the other parameters;
        infinite where nothing shows it or `neutral` is infinite.
      found: value nearest to neutral at which a diagnosis would adopt the effect; NaN where none in its range.
    """

    effect: str
    parameter: str
    unit: str
    neutral: float
    sigma: float
    found: float

    @property
    def is_visible(self) -> bool:
        """Whether any size in its range would be found."""
        return not math.isnan(self.found)

    def to_json(self) -> dict[str, object]:
        """Returns it as plain values, unfinite ones as in all answers."""
        return asdict(self)


@threadpool_limits.wrap(limits=1)
def detectable(campaign: Campaign, pool: ResidualPool, progress: Progress = silent) -> tuple[Detectable, ...]:
    """Returns what the fit recordings of a campaign can show, in the order of the library.

    Raises:
      InputError: the declared link diverges under the measured motion of the hub in every recording.
    """
    progress("simulating the declared model")
    bench, base = declared_fit(campaign, pool)
    names = candidate_names(base.model, bench.channels())
    found: list[Detectable] = []
    for k, name in enumerate(names, 1):
        progress(f"effect {k} of {len(names)}, {name}")
        found += sizes(bench, base, name)
    return tuple(found)


def sizes(bench: Workbench, base: Fit, name: str) -> Iterator[Detectable]:
    """Yields the parameters of an effect that have a size at its neutral value."""
    effect = REGISTRY[name]
    neutral = effect.neutral(base.model.declared)
    free = len(effect.free_parameters(neutral))
    factor = math.sqrt(2 * (rules.MODEL_ERROR_SCORE + bench.penalty(free)))
    moves: dict[str, list[_Move]] = {name: [] for name in _sized(effect, bench)}
    for ray in rays(bench, effect, neutral, base.model):
        length, change = visible_length(bench, base, name, neutral, ray, SLOPE_FACTOR)
        if change is None:  # the ray leaves the bounds
            continue
        along = _standard_error(bench, base, change / length, effect.replaces)
        least = _resolved_length(bench, name, neutral, ray, factor * along)
        for parameter in moves.keys() & ray.keys():
            if ray[parameter]:
                moves[parameter].append(_Move(len(ray) == 1, along * ray[parameter], least * ray[parameter]))
    for p in effect.parameters:
        if p.name in moves:
            # A ray that moves other parameters too says nothing of one that has a ray of its own.
            found = [move for move in moves[p.name] if move.alone] or moves[p.name]
            worst = max(found, key=lambda move: abs(move.least), default=_Move(False, math.inf, math.inf))
            yield _detectable(name, p, neutral[p.name], worst.sigma, worst.least)


class _Move(NamedTuple):
    """Moves of a parameter's fitted number along a ray: one standard error, and the least that is found.

    `alone` says whether the ray moves no other parameter.
    """

    alone: bool
    sigma: float
    least: float


def _sized(effect: Effect, bench: Workbench) -> list[str]:
    """Names of the parameters that say how large an effect is; of a coupled effect the first, which scales it."""
    sized = [
        p.name for p in effect.parameters if _has_size(p, bench) and p.name not in effect.undefined_at_neutral
    ]
    return sized[:1] if effect.is_coupled else sized


def _has_size(p: EffectParameter, bench: Workbench) -> bool:
    """Whether a parameter is a number, and acts on a channel that is recorded."""
    return not p.choice and (p.channel is None or p.channel in bench.channels())


def _detectable(name: str, p: EffectParameter, neutral: float, sigma: float, least: float) -> Detectable:
    """The parameter from the moves of its fitted number that are a standard error, and that are found."""
    at = p.turned(neutral)
    side = 1.0 if p.span[0] <= at + least <= p.span[1] else -1.0
    inside = p.span[0] <= at + side * least <= p.span[1]
    found = p.turned(at + side * least) if inside else math.nan
    error = abs(p.turned(at + side * sigma) - neutral) if math.isfinite(sigma) else math.inf
    return Detectable(name, p.name, p.unit, neutral, error, found)


def _resolved_length(
    bench: Workbench, name: str, neutral: Mapping[str, float], ray: Mapping[str, float], length: float
) -> float:
    """The length along a ray, from `length` on, from which the effect exceeds the tolerance of good sensors."""
    effect, period = REGISTRY[name], shortest_period(bench.prepared)
    while math.isfinite(length):
        values = point_on_ray(effect, neutral, ray, length) or point_on_ray(effect, neutral, ray, -length)
        if values is None:
            return math.inf
        if effect.is_resolved(values, period):
            break
        length *= _LONGER
    return length


def _standard_error(bench: Workbench, base: Fit, column: np.ndarray, replaced: Sequence[str]) -> float:
    """Standard error of the multiple of a column (n) of the Jacobian beside the unknowns of a fit, at noise level."""
    # The model is taken to be right up to the effect, so that the residual is the noise.
    noise = np.zeros(len(column))
    weights = row_weights(bench, noise)
    kept = np.flatnonzero(kept_beside(base, replaced))
    J, unknowns = base.jacobian[:, kept], [base.unknowns[k] for k in kept]
    normal, _ = normal_equations_at(bench, unknowns, base.values[kept], noise, J)
    scale = root_diagonal(normal)
    cross = (J.T @ (weights * column)) / scale
    explained = cross @ np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True) @ cross
    total = float(column @ (weights * column))
    # Less than a rounding error is left where the declared parameters reproduce the whole column.
    left = total - float(explained)
    return 1 / math.sqrt(left) if left > _ROUNDING * total and left > 0 else math.inf
