"""Levenberg-Marquardt minimisation of a fit's cost within bounds, with Broyden updates of the Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import (
    bounded_step,
    cost_of,
    difference_jacobian,
    first_steps,
    normal_equations_at,
    steps_from,
)
from twin.estimation.unknowns import Key, Unknown, model_and_starts_at
from twin.estimation.workbench import Workbench
from twin.mechanics.state import Start
from twin.rigs.model import Model

QUICK_ITERATIONS = 8
"""At most, of a fit that begins near its minimum or only shows whether one to convergence is worth it; a fit ends where
an iteration saves less than its tolerance."""
FAR_ITERATIONS = 20
"""At most, of a fit that may begin far from its minimum."""
_STEPS = 5
"""Steps for each Jacobian by differences, all but the first with an updated one; and dampings that are tried for the
first, each at least ten times the one before."""
_OPTIMISM = 3.0  # gain per remaining iteration that is still thought possible, in multiples of the last one's


def minimise(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    values: np.ndarray | None = None,
    fixed_jacobian: Mapping[Key, np.ndarray] | None = None,
    iterations: int = QUICK_ITERATIONS,
    tolerance: float = 0.05,
    report: Callable[[str], None] = lambda text: None,
    goal: float = np.inf,
    first_jacobian: np.ndarray | None = None,
) -> Fit:
    """Minimises the cost of `slopes` by Levenberg-Marquardt steps, blocks reweighted by their size at each step.

    A damped step hardly moves along a direction that the data leave to the priors, as the common factor of all masses
    and stiffnesses is without a sensor of the torque. So a fit ends where an undamped step promises no gain either.

    A Jacobian by differences takes one simulation per unknown. After it, steps are taken with the Jacobian that
    Broyden's update corrects, one simulation each, as long as they reduce the cost. Where the Jacobian has predicted
    the cost after the last of them within the tolerance, none by differences has to confirm the minimum.

    Args:
      bench: the data.
      model: where the unknowns are set; it has the effects that they belong to.
      starts: initial state of each recording.
      unknowns: (p).
      values: (p) first values, set to the nearest bound where they are beyond; by default the unknowns' own.
      fixed_jacobian: `Unknown.key` -> column (n) that is kept instead of computed (chord method).
      iterations: most Jacobians by differences.
      tolerance: reduction of the cost below which a step is the last one.
      report: called with the cost after each iteration.
      goal: the fit is given up when its cost would stay above this even if every remaining iteration gained three
        times as much as the last one.
      first_jacobian: (n x p) of an earlier fit nearby, instead of the first one by differences.

    Returns:
      The fit; its covariance is the inverse of the information, a Gauss-Newton Hessian.
    """
    unknowns = tuple(unknowns)
    x = np.array([u.start for u in unknowns]) if values is None else np.array(values, dtype=float)
    x = np.clip(x, *np.array([u.bounds for u in unknowns]).reshape(-1, 2).T)
    steps = first_steps(unknowns)
    fixed = fixed_jacobian or {}
    [r] = bench.residuals([(*model_and_starts_at(model, starts, unknowns, x), None)])
    at = _Point(x, r, cost_of(bench, unknowns, x, r), 1e-3)
    J = np.zeros((len(r), len(unknowns)))
    for iteration in range(iterations):
        before, enough = at.cost, tolerance * max(1.0, 1e-3 * at.cost)
        given = first_jacobian if iteration == 0 else None
        if given is not None:
            J = np.asarray(given, dtype=float)
        else:
            J, steps = difference_jacobian(bench, model, starts, unknowns, at.x, at.residual, steps, fixed)
        mistaken = np.inf
        for trials in (_STEPS, *(1,) * (_STEPS - 1)):
            better = _best_trial(bench, model, starts, unknowns, at, J, trials)
            gained = at.cost - better.cost
            if gained > 0:
                mistaken = abs(_predicted_cost(bench, unknowns, at, J, better.x) - better.cost)
                J = _broyden_update(J, better.x - at.x, better.residual - at.residual, steps)
            at = better
            if gained < enough:
                if gained == 0 or _promised_gain(bench, unknowns, at, J) < enough:
                    break
                at = replace(at, damping=0.0)
        report(f"iteration {iteration + 1}: cost {at.cost:.1f}")
        if (given is None and before - at.cost < enough) or (gained < enough and mistaken < enough):
            break
        if at.cost - _OPTIMISM * (before - at.cost) * (iterations - 1 - iteration) > goal:
            break
    x, r, cost = at.x, at.residual, at.cost
    size = bench.sizes(r)
    fitted, states = model_and_starts_at(model, starts, unknowns, x)
    information, _ = normal_equations_at(bench, unknowns, x, r, J)
    return Fit(fitted, states, unknowns, x, np.linalg.pinv(information, hermitian=True), r, size, cost, J)


def with_own_jacobian(bench: Workbench, fit: Fit) -> Fit:
    """The fit with its Jacobian by differences there, in place of one that Broyden's updates corrected on the way.

    An update is right along its step, and may be wrong by per cents elsewhere. This hides a direction along which the
    columns cancel, and effects that are added to the fit inherit its columns. Differences are one-sided, each of one
    unknown: `refine.with_jacobian` takes twice as many simulations.
    """
    at, steps = (bench, fit.model, fit.starts, fit.unknowns), steps_from(fit.unknowns, fit.jacobian)
    J, _ = difference_jacobian(*at, fit.values, fit.residual, steps, {})
    information, _ = normal_equations_at(bench, fit.unknowns, fit.values, fit.residual, J)
    return replace(fit, jacobian=J, covariance=np.linalg.pinv(information, hermitian=True))


@dataclass(frozen=True, eq=False)
class _Point:
    """State of a minimisation: values (p), residual (n), cost, and damping of the next step."""

    x: np.ndarray
    residual: np.ndarray
    cost: float
    damping: float


def _best_trial(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    at: _Point,
    J: np.ndarray,
    trials: int,
) -> _Point:
    """The first of some steps of growing damping that reduces the cost; without one, `at` itself."""
    damping = at.damping
    normal, gradient = normal_equations_at(bench, unknowns, at.x, at.residual, J)
    for _ in range(trials):
        trial = _damped_step(unknowns, at.x, normal, gradient, damping)
        [r] = bench.residuals([(*model_and_starts_at(model, starts, unknowns, trial), None)])
        cost = cost_of(bench, unknowns, trial, r)
        if cost < at.cost:
            return _Point(trial, r, cost, damping / 10)
        damping = max(10 * damping, 1e-2)
    return at


def _promised_gain(bench: Workbench, unknowns: Sequence[Unknown], at: _Point, J: np.ndarray) -> float:
    """Reduction of the cost that an undamped step promises: a bound of what linear theory still has to gain."""
    step = _damped_step(unknowns, at.x, *normal_equations_at(bench, unknowns, at.x, at.residual, J), 0.0)
    return at.cost - _predicted_cost(bench, unknowns, at, J, step)


def _predicted_cost(
    bench: Workbench, unknowns: Sequence[Unknown], at: _Point, J: np.ndarray, x: np.ndarray
) -> float:
    """Cost at values x (p) where the residual is linear in them with the Jacobian J (n x p)."""
    return cost_of(bench, unknowns, x, at.residual + bench.weight * (J @ (x - at.x)))


def _broyden_update(J: np.ndarray, moved: np.ndarray, change: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """The Jacobian (n x p) nearest to J that reproduces a measured change of the residual (C. G. Broyden, 1965).

    Args:
      J: (n x p).
      moved: step of the unknowns (p).
      change: of the residual (n) by that step.
      steps: (p) changes of each unknown that are about equally visible: the unit in which nearness is measured.
    """
    scaled = moved / steps**2
    length = float(scaled @ moved)
    return J + np.outer(change - J @ moved, scaled / length) if length > 0 else J


def _damped_step(
    unknowns: Sequence[Unknown], x: np.ndarray, normal: np.ndarray, gradient: np.ndarray, damping: float
) -> np.ndarray:
    """Values (p) after a step from x with the diagonal of the information raised by `damping`, within the bounds.

    Args:
      unknowns: (p).
      x: (p) values.
      normal, gradient: information (p x p) and gradient (p) there.
      damping: share of the diagonal that is added to it [1].
    """
    low, high = np.array([u.bounds for u in unknowns]).T
    step = bounded_step(normal + damping * np.diag(np.diag(normal)), gradient, low - x, high - x)
    return np.clip(x + step, low, high)
