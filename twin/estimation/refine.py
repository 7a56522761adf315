"""The last steps of a fit, with slopes along the axes of its own ellipse.

Parameters that move together leave the residual almost as it is, each alone changes it a hundred times as much. Slopes
by each parameter, taken over steps of its own, are too rough for the difference that is left; taken along the ridge,
over one standard error to either side, they are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import cost_of, normal_equations
from twin.estimation.unknowns import placed_both
from twin.estimation.workbench import Workbench

_ROUNDS = 3
WORTH = 0.02
"""Gain in cost that is worth a step: what is a fifth of a standard error away costs that much."""
_NOTHING = 1e-6  # noise levels by which a residual may change in all, where nothing is seen
_HALVES = 3  # times that a step which makes things worse is halved
_CLIFF = 10.0
"""Times as far off a parabola as on the other side, and by more than a nat, is a cost that jumps."""
_OF_SMALLER = 1.0 + 0.5 * np.sqrt(2.0)
"""Mean size of one of two normal deviations, over that of the smaller: 1/(2 - sqrt(2))."""


def refined(bench: Workbench, base: Fit) -> Fit:
    """The fit taken to its end by Gauss-Newton steps; its covariance is the inverse of the information there."""
    # The bench may have changed since.
    [r] = bench.residuals([(base.model, base.starts, None)])
    base = _at(bench, base, base.values, r, base.covariance)
    for _ in range(_ROUNDS):
        base = with_slopes(bench, base)
        if promised(bench, base) < WORTH:
            break
        base = _stepped(bench, base)
    information, _ = normal_equations(bench, base)
    return _at(bench, base, base.values, base.residual, np.linalg.pinv(information, hermitian=True))


def promised(bench: Workbench, base: Fit) -> float:
    """Gain in cost that a Gauss-Newton step from a fit promises."""
    information, gradient = normal_equations(bench, base)
    return 0.5 * float(gradient @ np.linalg.pinv(information, hermitian=True) @ gradient)


def with_slopes(bench: Workbench, base: Fit) -> Fit:
    """The fit with its slopes by differences along the axes of its ellipse; zero for what moves nothing."""
    axes, ends = _axes(base, normal_equations(bench, base)[0])
    return _sloped(base, ends, _residuals(bench, base, ends))


def looked_along(bench: Workbench, base: Fit) -> tuple[Fit, np.ndarray]:
    """The fit with its slopes as `with_slopes`, and the covariance (p x p) that the roughness of its cost adds.

    Impacts in a play make a cost rough: a standard error away it rises by more or less than half, and its least value
    is anywhere within what this hides. Along each axis of the ellipse the variance is so much larger as a parabola
    takes to rise by the roughness. That shows to both sides: a cost that jumps on one side, where a torque that is
    read at the instants of its steps is late by a sample more, bounds a value and makes it no less certain; slopes are
    those of the other side then.
    """
    axes, ends = _axes(base, normal_equations(bench, base)[0])
    # The residual where it stands may be of other data than these.
    *found, here = _residuals(bench, base, [*ends, base.values])
    base = _at(bench, base, base.values, here, base.covariance)
    information, gradient = normal_equations(bench, base)
    rises = [cost_of(bench, base.unknowns, x, r) - base.cost for x, r in zip(ends, found, strict=True)]
    moves = [x - base.values for x in ends]
    parabola = [gradient @ m + 0.5 * m @ information @ m for m in moves]
    off = np.abs(np.array(rises) - parabola).reshape(-1, 2)
    for k in np.flatnonzero((off > 1.0) & (off > _CLIFF * off[:, ::-1])):
        ends[k], found[k] = base.values, here
    roughness = _OF_SMALLER * off.min(axis=1)
    return _sloped(base, ends, found), (2 * roughness * axes) @ axes.T


def _axes(base: Fit, information: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """The axes (p x k) of the ellipse of a fit, a standard error long, and their ends (2 k) within the ranges."""
    mine = np.flatnonzero(seen(base))
    information = information[np.ix_(mine, mine)]
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    size, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    axes = np.zeros((len(base.values), len(mine)))
    axes[mine] = scale[:, None] * vectors / np.sqrt(np.maximum(size, 1e-12))
    low, high = np.array([u.bounds for u in base.unknowns]).T
    return axes, [np.clip(base.values + side * axis, low, high) for axis in axes.T for side in (1, -1)]


def _residuals(bench: Workbench, base: Fit, points: Sequence[np.ndarray]) -> list[np.ndarray]:
    return bench.residuals([(*placed_both(base.model, base.starts, base.unknowns, x), None) for x in points])


def _sloped(base: Fit, ends: Sequence[np.ndarray], found: Sequence[np.ndarray]) -> Fit:
    """The fit with the slopes that residuals at the ends of its axes show."""
    mine = np.flatnonzero(seen(base))
    apart = np.array(ends[::2]) - np.array(ends[1::2])
    change = np.array(found[::2]) - np.array(found[1::2])
    jacobian = np.zeros_like(base.jacobian)
    jacobian[:, mine] = np.linalg.lstsq(apart[:, mine], change, rcond=None)[0].T
    return replace(base, jacobian=jacobian)


def seen(base: Fit) -> np.ndarray:
    """Which unknowns (p) are more than first states that move nothing: a driven hub is where it was measured.

    Slopes along the ridge would follow them for ever.
    """
    change = np.linalg.norm(base.jacobian, axis=0) * [u.scale for u in base.unknowns]
    return np.array([u.owner != "start" for u in base.unknowns]) | (change > _NOTHING)


def _stepped(bench: Workbench, base: Fit) -> Fit:
    """The fit after a Gauss-Newton step within the bounds, or where it was if that is no better."""
    information, gradient = normal_equations(bench, base)
    step = -np.linalg.pinv(information, hermitian=True) @ gradient
    low, high = np.array([u.bounds for u in base.unknowns]).T
    for half in range(_HALVES + 1):
        x = np.clip(base.values + step / 2**half, low, high)
        [r] = bench.residuals([(*placed_both(base.model, base.starts, base.unknowns, x), None)])
        there = _at(bench, base, x, r, base.covariance)
        if there.cost < base.cost:
            return there
    return base


def _at(bench: Workbench, base: Fit, x: np.ndarray, r: np.ndarray, covariance: np.ndarray) -> Fit:
    cost = cost_of(bench, base.unknowns, x, r)
    model, starts = placed_both(base.model, base.starts, base.unknowns, x)
    return Fit(model, starts, base.unknowns, x, covariance, r, bench.sizes(r), cost, base.jacobian)
