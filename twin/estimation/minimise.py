"""Fits of a model to recordings: declared parameters within their uncertainty, effects freely."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import _jacobian, cost_of, equations_at
from twin.estimation.unknowns import Key, Unknown, placed_both
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Start
from twin.rigs.model import Model

_TRIALS, _SECANTS = 5, 4  # trials of a step with a new Jacobian; steps with one that was put right
_PACE = 3.0  # times what the last iteration gained that those to come may gain


def minimise(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    values: np.ndarray | None = None,
    fixed_jacobian: Mapping[Key, np.ndarray] | None = None,
    iterations: int = 8,
    tolerance: float = 0.05,
    report: Callable[[str], None] = lambda text: None,
    goal: float = np.inf,
) -> Fit:
    """Levenberg-Marquardt on the groups' losses, each group weighted by its own size.

    Between two Jacobians by differences, steps are taken with the one that the last step has put right, as long as
    they gain: one simulation each in place of one for each unknown.

    Args:
      bench: the recordings.
      model: where to start; its effects contain those of the unknowns.
      starts: states at the first samples.
      unknowns: what may move (p).
      values: (p) first values; by default the unknowns' own.
      fixed_jacobian: columns (n) that need not be computed again, by their `key`: a chord method.
      iterations: at most so many.
      tolerance: a step that gains less than this in cost is the last.
      report: told of every iteration.
      goal: cost that it is worth going on for: given up is what would not get there at three times its pace.
    """
    unknowns = tuple(unknowns)
    x = np.array([u.start for u in unknowns]) if values is None else np.array(values, dtype=float)
    steps = np.array([0.1 * u.scale if u.prior else u.scale for u in unknowns])
    fixed = fixed_jacobian or {}
    [r] = bench.residuals([(*placed_both(model, starts, unknowns, x), None)])
    at = _Point(x, r, cost_of(bench, unknowns, x, r), 1e-3)
    J = np.zeros((len(r), len(unknowns)))
    for iteration in range(iterations):
        before, enough = at.cost, tolerance * max(1.0, 1e-3 * at.cost)
        J, steps = _jacobian(bench, model, starts, unknowns, at.x, at.residual, steps, fixed)
        for trials in (_TRIALS, *(1,) * _SECANTS):
            better = _improved(bench, model, starts, unknowns, at, J, trials)
            gained = at.cost - better.cost
            if better is not at:
                J = _secant(J, better.x - at.x, better.residual - at.residual, steps)
            at = better
            if gained < enough:
                break
        report(f"iteration {iteration + 1}: cost {at.cost:.1f}")
        if before - at.cost < enough:
            break
        if at.cost - _PACE * (before - at.cost) * (iterations - 1 - iteration) > goal:
            break
    x, r, cost = at.x, at.residual, at.cost
    size = bench.sizes(r)
    fitted, states = placed_both(model, starts, unknowns, x)
    information, _ = equations_at(bench, unknowns, x, r, J)
    return Fit(fitted, states, unknowns, x, np.linalg.pinv(information, hermitian=True), r, size, cost, J)


@dataclass(frozen=True, eq=False)
class _Point:
    """Where a fit stands: values (p), residual (n), cost, and damping of the next step."""

    x: np.ndarray
    residual: np.ndarray
    cost: float
    damping: float


def _improved(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    at: _Point,
    J: np.ndarray,
    trials: int,
) -> _Point:
    """The first of some trials, each damped more than that before it, that costs less; else the point itself."""
    damping = at.damping
    for _ in range(trials):
        trial = _step(bench, unknowns, at.x, at.residual, J, damping)
        [r] = bench.residuals([(*placed_both(model, starts, unknowns, trial), None)])
        cost = cost_of(bench, unknowns, trial, r)
        if cost < at.cost:
            return _Point(trial, r, cost, damping / 10)
        damping = max(10 * damping, 1e-2)
    return at


def _secant(J: np.ndarray, moved: np.ndarray, change: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The Jacobian (n x p) that agrees with the change (n) of a move (p), all else as it was (C. G. Broyden, 1965).

    `steps` (p) are moves of each unknown that are about equally visible.
    """
    scaled = moved / steps**2
    length = float(scaled @ moved)
    return J + np.outer(change - J @ moved, scaled / length) if length > 0 else J


def _step(
    bench: Workbench,
    unknowns: Sequence[Unknown],
    x: np.ndarray,
    r: np.ndarray,
    J: np.ndarray,
    damping: float,
) -> np.ndarray:
    normal, gradient = equations_at(bench, unknowns, x, r, J)
    ridge = damping * np.diag(normal) + 1e-12 * np.trace(normal) / len(x)
    low, high = np.array([u.bounds for u in unknowns]).T
    free = np.ones(len(x), dtype=bool)
    # Unknowns that would leave their range stay on its edge; the others are solved for again.
    for _ in range(len(x)):
        move = np.zeros(len(x))
        system = normal[np.ix_(free, free)] + np.diag(ridge[free])
        move[free] = -np.linalg.lstsq(system, gradient[free], rcond=None)[0]
        beyond = free & ((x + move < low) | (x + move > high))
        at_edge = beyond & ((np.abs(x - low) < 1e-15) | (np.abs(x - high) < 1e-15))
        if not at_edge.any():
            break
        free &= ~at_edge
    return np.clip(x + move, low, high)
