"""Cost, gradient and Gauss-Newton Hessian of a fit, its Jacobian by differences, and linear predictions from it.

Throughout: p unknowns, n residuals, g blocks. The cost is

    sum over blocks of count * loss(size) + sum over priors of ((x - mean) / deviation)^2 / 2

Its Gauss-Newton Hessian J' W J + P, with the row weights W and the prior precisions P, is called the information.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import lsq_linear

from twin.estimation.fit import Fit
from twin.estimation.unknowns import Key, Unknown, model_and_starts_at
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Start
from twin.residuals.numerics import ROUNDING
from twin.rigs.model import Model

_TARGET_CHANGE = 0.01
"""Root-mean-square change of the residual, in multiples of the noise, that a finite difference aims at.

Of ten thousand readings it is a change by one standard error, the distance at which curvature may matter. By hand, on a
rig without a sensor of the torque, where the columns of masses, stiffnesses, frictions and a gain of the drive cancel:
with 0.5 they were wrong by 0.8 %, and 1.9e6 stood in the information of that direction beside 2.3e4 of the priors; with
0.01 it is 6e3."""


def costs_at(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    points: Sequence[np.ndarray],
) -> np.ndarray:
    """Cost at each of some points, each (p); simulated in parallel."""
    residuals = bench.residuals([(*model_and_starts_at(model, starts, unknowns, x), None) for x in points])
    return np.array([cost_of(bench, unknowns, x, r) for x, r in zip(points, residuals, strict=True)])


def prior_precision(unknowns: Sequence[Unknown]) -> np.ndarray:
    """Reciprocal variance of each unknown's prior (p); 0 without a prior."""
    return np.array([1 / u.scale**2 if u.prior else 0.0 for u in unknowns])


def first_steps(unknowns: Sequence[Unknown]) -> np.ndarray:
    """Steps (p) with which differences begin: a tenth of a prior's deviation, else the unknown's visible change."""
    return np.array([0.1 * u.scale if u.prior else u.scale for u in unknowns])


def steps_from(unknowns: Sequence[Unknown], J: np.ndarray) -> np.ndarray:
    """Steps (p) that change the residual by `_TARGET_CHANGE` where its Jacobian is J (n x p)."""
    slopes = np.sqrt(np.mean(J**2, axis=0))
    return np.minimum(_TARGET_CHANGE / np.maximum(slopes, np.finfo(float).tiny), first_steps(unknowns))


def cost_of(bench: Workbench, unknowns: Sequence[Unknown], x: np.ndarray, r: np.ndarray) -> float:
    """Cost of values x (p) whose residual is r (n): loss of the blocks plus priors."""
    return float(bench.cost(r) + prior_cost(unknowns, x))


def prior_cost(unknowns: Sequence[Unknown], x: np.ndarray) -> float:
    """Part of the cost of values x (p) that is due to their priors."""
    return sum(0.5 * ((v - u.start) / u.scale) ** 2 for u, v in zip(unknowns, x, strict=True) if u.prior)


def row_weights(bench: Workbench, r: np.ndarray) -> np.ndarray:
    """Weight of each squared residual (n) in the information.

    Independent samples per row of its block, over the square of the block's size where that exceeds the noise: the
    weights with which the gradient of weighted least squares is that of `loss`.
    """
    starts = [g.rows.start for g in bench.groups]
    total = np.maximum(np.add.reduceat(bench.weight, starts), 1)
    of_group = bench.count / total / np.maximum(1.0, bench.sizes(r)) ** 2
    return np.repeat(of_group, [g.rows.stop - g.rows.start for g in bench.groups]) * bench.weight


def normal_equations_at(
    bench: Workbench, unknowns: Sequence[Unknown], x: np.ndarray, r: np.ndarray, J: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information (p x p) and gradient (p) of the cost at values x (p) with residual r (n) and Jacobian J (n x p)."""
    prior = prior_precision(unknowns)
    away = np.array([v - u.start for u, v in zip(unknowns, x, strict=True)])
    root = np.sqrt(row_weights(bench, r))
    weighted = root[:, None] * J  # numpy computes half of a product of a matrix with its own transpose
    return weighted.T @ weighted + np.diag(prior), weighted.T @ (root * r) + prior * away


def normal_equations(bench: Workbench, base: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Information (p x p) and gradient (p) of the cost at a fit."""
    return normal_equations_at(bench, base.unknowns, base.values, base.residual, base.jacobian)


def linear_gain(bench: Workbench, base: Fit, columns: np.ndarray, replaced: Sequence[str] = ()) -> float:
    """Reduction of the cost that `linear_move` predicts: a score test of additional unknowns.

    The predicted residual is put into the blocks' losses: down to the noise, a block of n independent samples gains n
    times the logarithm of the ratio of its sizes before and after.
    """
    change, _, own = linear_move(bench, base, columns, replaced)
    kept = kept_beside(base, replaced)
    left = prior_cost([u for u, k in zip(base.unknowns, kept, strict=True) if k], base.values[kept] + own)
    saved = prior_cost(base.unknowns, base.values) - left
    return bench.cost(base.residual) - bench.cost(base.residual + change) + saved


def kept_beside(base: Fit, replaced: Sequence[str]) -> np.ndarray:
    """Which unknowns (p) of a fit remain beside an effect that replaces these declared parameters."""
    return np.array([u.kind != "rig" or u.name not in replaced for u in base.unknowns], dtype=bool)


def linear_move(
    bench: Workbench, base: Fit, columns: np.ndarray, replaced: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One Gauss-Newton step of a fit with additional unknowns, the fit's own unknowns free within their bounds.

    Args:
      bench: the data.
      base: the fit without the additional unknowns.
      columns: (n x k) derivative of the residual by these; they have neither prior nor bounds.
      replaced: declared parameters that are no longer unknowns beside them.

    Returns:
      The predicted change of the residual (n), the step of the additional unknowns (k), and that of the fit's own that
      are not replaced.
    """
    weights, kept = row_weights(bench, base.residual), kept_beside(base, replaced)
    prior = prior_precision(base.unknowns)[kept]
    away = np.array([v - u.start for u, v in zip(base.unknowns, base.values, strict=True)])[kept]
    J = np.hstack([base.jacobian[:, kept], columns])
    normal = J.T @ (weights[:, None] * J) + np.diag(np.r_[prior, np.zeros(columns.shape[1])])
    gradient = J.T @ (weights * base.residual) + np.r_[prior * away, np.zeros(columns.shape[1])]
    low, high = np.array([u.bounds for u in base.unknowns])[kept].T
    here = base.values[kept]
    beyond = np.full(columns.shape[1], np.inf)
    step = bounded_step(normal, gradient, np.r_[low - here, -beyond], np.r_[high - here, beyond])
    return J @ step * bench.weight, step[len(here) :], step[: len(here)]


def root_diagonal(normal: np.ndarray) -> np.ndarray:
    """Roots (p) of the diagonal of an information matrix (p x p), positive: divided by them it has a unit diagonal."""
    return np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))


def bounded_step(normal: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step m (p) that minimises gradient' m + m' normal m / 2 within low <= m <= high, each (p).

    It is 0 for an unknown of which there is no information.
    """
    step, told = np.zeros(len(gradient)), np.diag(normal) > 0
    if not told.any():
        return step
    scale = root_diagonal(normal)[told]
    values, vectors = np.linalg.eigh(normal[np.ix_(told, told)] / np.outer(scale, scale))
    root = np.sqrt(np.maximum(values, 1e-10 * values.max()))
    system, right = (vectors * root).T, -(vectors / root).T @ (gradient[told] / scale)
    bounds = (np.minimum(low[told] * scale, -ROUNDING), np.maximum(high[told] * scale, ROUNDING))
    step[told] = lsq_linear(system, right, bounds).x / scale
    return step


def difference_jacobian(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    x: np.ndarray,
    r: np.ndarray,
    steps: np.ndarray,
    fixed: Mapping[Key, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian of the residual by one-sided differences.

    Args:
      bench: the data.
      model, starts: where the unknowns are set.
      unknowns: (p).
      x: values (p).
      r: residual there (n).
      steps: (p) lengths of the differences, shortened at a bound.
      fixed: `Unknown.key` -> column (n) that is taken over instead of computed.

    Returns:
      The Jacobian (n x p), and for the next one the steps (p) that would change the residual by `_TARGET_CHANGE`.
    """
    J, steps = np.zeros((len(r), len(unknowns)), order="F"), steps.copy()
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
        jobs.append((*model_and_starts_at(model, starts, unknowns, moved), u.recording))
    for (j, h), moved_r in zip(columns, bench.residuals(jobs), strict=True):
        only = unknowns[j].recording
        change = moved_r - r
        for group in bench.groups:
            if only is not None and group.recording != only:
                change[group.rows] = 0.0
        visible = np.sqrt(np.mean(change**2))
        if visible < ROUNDING:
            continue  # no influence, as of the first angle of a hub that drives the link
        J[:, j] = change / h
        limit = unknowns[j].scale if unknowns[j].prior else 1e3 * abs(h)
        steps[j] = min(abs(h) * np.clip(_TARGET_CHANGE / visible, 1e-2, 1e2), limit)
    return J, steps
