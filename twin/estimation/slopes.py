"""Cost, gradient and information of a fit, and what slopes promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import lsq_linear

from twin.estimation.fit import Fit
from twin.estimation.unknowns import Key, Unknown, placed_both
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Start
from twin.rigs.model import Model

_VISIBLE = 0.5  # a finite difference moves the residual by this many noise levels (rms)


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
