"""Rays: straight lines from neutral in the space of an effect's parameters, on which its fits begin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest

import numpy as np

from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.residuals.numerics import ROUNDING
from twin.rigs.model import Model

Reached = tuple[float, float]
"""A length along a ray, and the root-mean-square change of the residual there [noise levels]."""


def with_effect(model: Model, name: str, values: Mapping[str, float]) -> Model:
    """The model with an effect added, or with other parameters of it."""
    return model.replace(effects={**model.effects, name: dict(values)})


def best_on_rays(
    bench: Workbench, base: Fit, name: str, reached: Sequence[Reached | None] = ()
) -> tuple[dict[str, float], float]:
    """The point on the rays with the lowest cost, nothing else refitted, and its cost.

    Of each ray a length may be `reached` already, from which the visible one follows sooner.
    Points are compared by successive halving (Z. Karnin, T. Koren and O. Somekh, ICML 2013): after each recording those
    are dropped whose cost so far is above the median.
    """
    effect = REGISTRY[name]
    neutral = effect.neutral(base.model.declared)
    points = list[dict[str, float]]()
    for ray, known in zip_longest(rays(bench, effect, neutral, base.model), reached):
        step, _ = visible_length(bench, base, name, neutral, ray, reached=known)
        points += _points_on_ray(effect, neutral, ray, step)
    if not points:
        return neutral, np.inf
    costs = np.zeros(len(points))
    for recording in _most_unexplained_first(bench, base):
        kept = np.flatnonzero(costs <= np.median(costs))
        points, costs = [points[k] for k in kept], costs[kept]
        jobs = [(with_effect(base.model, name, p), base.starts, recording) for p in points]
        # Of the other recordings the residuals are zero, and cost nothing.
        costs = costs + [bench.cost(r) for r in bench.residuals(jobs)]
    best = int(np.argmin(costs))
    return points[best], float(costs[best])


def _points_on_ray(
    effect, neutral: Mapping[str, float], ray: Mapping[str, float], step: float
) -> list[dict[str, float]]:
    """Points at the effect's multiples of a step along a ray, both ways, within the range of the parameters."""
    lengths = [sign * step * multiple for multiple in effect.search_multiples for sign in (1, -1)]
    points = [point_on_ray(effect, neutral, ray, length) for length in lengths]
    return [point for point in points if point is not None]


def _most_unexplained_first(bench: Workbench, base: Fit) -> list[int]:
    """Indices of the recordings, that with the largest misfit of a fit first."""
    return np.argsort(-bench.by_recording(bench.misfits(base.residual)), kind="stable").tolist()


def rays(bench: Workbench, effect, neutral: Mapping[str, float], model: Model) -> list[dict[str, float]]:
    """Increments of the fitted numbers from neutral: to each start of the effect, and along each parameter alone."""
    channels = bench.channels()
    usable = [p for p in effect.parameters if p.channel is None or p.channel in channels]
    turn = {p.name: p.turned for p in effect.parameters}
    to_starts = [
        {k: turn[k](v) - turn[k](neutral[k]) for k, v in start.items()}
        for start in effect.starts(model.declared)
        if effect.fits(start, model.sensors)
    ]
    single = [{p.name: p.step} for p in usable] if len(usable) > 1 and not effect.is_coupled else []
    return to_starts + single


def visible_length(
    bench: Workbench,
    base: Fit,
    name: str,
    neutral: Mapping[str, float],
    ray: Mapping[str, float],
    tolerance: float = 3.0,
    reached: Reached | None = None,
) -> tuple[float, np.ndarray | None]:
    """A length along a ray at which the residual changes by one noise level (rms), within a factor, and the change (n).

    Where that is not met in the range of the parameters, or within four trials, it is the last length that was tried.
    The change is None if already the first is out of range, or if the length was `reached` before.
    """
    length, tried, change = 1.0, 1.0, None
    if reached is not None:
        tried, size = reached
        if _is_near(size, tolerance):
            return tried, None
        length = tried * _to_visible(size)
    for _ in range(4):
        forward = point_on_ray(REGISTRY[name], neutral, ray, length)
        point = forward or point_on_ray(REGISTRY[name], neutral, ray, -length)
        if point is None:
            break
        [r] = bench.residuals([(with_effect(base.model, name, point), base.starts, None)])
        tried, change = length, (r - base.residual) * (1.0 if forward else -1.0)
        size = size_of(change)
        if _is_near(size, tolerance):
            break
        length *= _to_visible(size)
    return tried, change


def size_of(change: np.ndarray) -> float:
    """Root-mean-square change of a residual (n) [noise levels]."""
    return float(np.sqrt(np.mean(change**2)))


def _is_near(size: float, tolerance: float) -> bool:
    """Whether a change is of one noise level, within a factor."""
    return 1 / tolerance < size < tolerance


def _to_visible(size: float) -> float:
    """Factor from a length at which the residual changes by `size` to one at which it changes by one noise level."""
    return float(np.clip(1 / max(size, ROUNDING), 1e-3, 1e3))


def point_on_ray(effect, neutral: Mapping[str, float], ray: Mapping[str, float], length: float):
    """Parameters at a length along a ray; None beyond the bounds of a parameter."""
    point = dict(neutral)
    for p in effect.parameters:
        if p.name not in ray:
            continue
        moved = ray[p.name] if p.name in effect.undefined_at_neutral else ray[p.name] * length
        value = p.turned(neutral[p.name]) + moved
        if not p.span[0] <= value <= p.span[1]:
            return None
        point[p.name] = p.turned(value)
    return point
