"""Final Gauss-Newton steps of a fit, with a Jacobian by central differences along the axes of its error ellipse.

Strongly correlated parameters change the residual a hundred times less along the long axis of the error ellipse than
each does alone. Differences along the parameters are too inaccurate to resolve that; central differences along the
axes, one standard error to either side, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import cost_of, normal_equations, root_diagonal
from twin.estimation.unknowns import model_and_starts_at
from twin.estimation.workbench import Workbench
from twin.residuals.numerics import GAUSS_NEWTON_STEPS, ROUNDING

MIN_GAIN = 0.02
"""Reduction of the cost that is worth a step: the minimum is then a fifth of a standard error away (0.2^2/2)."""
_HALVINGS = 3  # times that a step which raises the cost is halved
_ONE_SIDED = 10.0
"""A side is discontinuous if it departs from the quadratic by more than 1 nat and ten times as far as the other."""


def refined_fit(bench: Workbench, base: Fit) -> Fit:
    """The fit after Gauss-Newton steps to convergence; its covariance is the inverse of the information there."""
    base = evaluated_on(bench, base)
    for _ in range(GAUSS_NEWTON_STEPS):
        base = with_jacobian(bench, base)
        if predicted_gain(bench, base) < MIN_GAIN:
            break
        base = _gauss_newton_step(bench, base)
    information, _ = normal_equations(bench, base)
    return _fit_at(bench, base, base.values, base.residual, np.linalg.pinv(information, hermitian=True))


def evaluated_on(bench: Workbench, base: Fit) -> Fit:
    """The fit as it is, with residual and cost of these data, which may differ from those that it was fitted to."""
    [r] = bench.residuals([(base.model, base.starts, None)])
    return replace(base, residual=r, size=bench.sizes(r), cost=cost_of(bench, base.unknowns, base.values, r))


def refined_with_roughness(bench: Workbench, base: Fit) -> tuple[Fit, np.ndarray]:
    """As `jacobian_and_roughness`, after Gauss-Newton steps to convergence."""
    smooth, roughness = jacobian_and_roughness(bench, base)
    for _ in range(GAUSS_NEWTON_STEPS):
        if predicted_gain(bench, smooth) <= MIN_GAIN:
            break
        before, nearer = smooth.cost, _gauss_newton_step(bench, smooth)
        smooth, roughness = jacobian_and_roughness(bench, nearer)
        if before - smooth.cost < MIN_GAIN:
            break
    return smooth, roughness


def predicted_gain(bench: Workbench, base: Fit) -> float:
    """Reduction of the cost that a Gauss-Newton step predicts: g' H^-1 g / 2, half the squared Newton decrement."""
    information, gradient = normal_equations(bench, base)
    return 0.5 * float(gradient @ np.linalg.pinv(information, hermitian=True) @ gradient)


def with_jacobian(bench: Workbench, base: Fit) -> Fit:
    """The fit with its Jacobian by differences along the axes of its ellipse; zero for unobservable unknowns."""
    axes, ends = _ellipse_axes(base, normal_equations(bench, base)[0])
    return _with_differences(base, ends, _residuals(bench, base, ends))


def jacobian_and_roughness(bench: Workbench, base: Fit) -> tuple[Fit, np.ndarray]:
    """The fit with its Jacobian as `with_jacobian`, and the covariance (p x p) to add for a rough cost.

    Impacts in a backlash make the cost rough: one standard error from its minimum it rises by more or less than the
    1/2 of the quadratic, and its minimum may lie anywhere within the range that the roughness hides. Along each axis of
    the ellipse, the added variance is the square of the distance at which the quadratic rises by the roughness.

    Roughness shows on both sides of an axis. A discontinuity on one side only (a torque that is read at the instants
    of its steps arrives one sample later) bounds the value and does not make it less certain: it adds no variance, and
    the Jacobian is taken from the other side.
    """
    axes, ends = _ellipse_axes(base, normal_equations(bench, base)[0])
    # The residual of the fit may belong to other data than those of the bench.
    *residuals, here = _residuals(bench, base, [*ends, base.values])
    base = _fit_at(bench, base, base.values, here, base.covariance)
    information, gradient = normal_equations(bench, base)
    rises = [cost_of(bench, base.unknowns, x, r) - base.cost for x, r in zip(ends, residuals, strict=True)]
    moves = [x - base.values for x in ends]
    quadratic = [gradient @ m + 0.5 * m @ information @ m for m in moves]
    departure = np.abs(np.array(rises) - quadratic).reshape(-1, 2)
    for k in np.flatnonzero((departure > 1.0) & (departure > _ONE_SIDED * departure[:, ::-1])):
        ends[k], residuals[k] = base.values, here
    # The smaller of two normal deviates has 2 - sqrt(2) times the expected magnitude of one.
    roughness = departure.min(axis=1) / (2 - np.sqrt(2))
    return _with_differences(base, ends, residuals), (2 * roughness * axes) @ axes.T


def _ellipse_axes(base: Fit, information: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Axes of the error ellipse, and the points at their ends.

    Args:
      base: the fit.
      information: (p x p).

    Returns:
      The semi-axes (p x k), one standard error long, of the k observable unknowns; and 2 k points, each (p), at plus
      and minus each semi-axis in turn, clipped to the bounds.
    """
    mine = np.flatnonzero(observable(base))
    information = information[np.ix_(mine, mine)]
    scale = 1 / root_diagonal(information)
    size, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    axes = np.zeros((len(base.values), len(mine)))
    axes[mine] = scale[:, None] * vectors / np.sqrt(np.maximum(size, 1e-12))
    low, high = np.array([u.bounds for u in base.unknowns]).T
    return axes, [np.clip(base.values + side * axis, low, high) for axis in axes.T for side in (1, -1)]


def _residuals(bench: Workbench, base: Fit, points: Sequence[np.ndarray]) -> list[np.ndarray]:
    return bench.residuals(
        [(*model_and_starts_at(base.model, base.starts, base.unknowns, x), None) for x in points]
    )


def _with_differences(base: Fit, ends: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> Fit:
    """The fit with the Jacobian that follows from the residuals at both ends of each axis."""
    mine = np.flatnonzero(observable(base))
    apart = np.array(ends[::2]) - np.array(ends[1::2])
    change = np.array(residuals[::2]) - np.array(residuals[1::2])
    jacobian = np.zeros_like(base.jacobian)
    jacobian[:, mine] = np.linalg.lstsq(apart[:, mine], change, rcond=None)[0].T
    return replace(base, jacobian=jacobian)


def observable(base: Fit) -> np.ndarray:
    """Which unknowns (p) influence the residual; parameters count as observable in any case.

    The initial angle of a hub whose measured angle drives the link has no influence. Its axis would be infinitely long.
    """
    change = np.linalg.norm(base.jacobian, axis=0) * [u.scale for u in base.unknowns]
    return np.array([u.kind != "start" for u in base.unknowns]) | (change > ROUNDING)


def _gauss_newton_step(bench: Workbench, base: Fit) -> Fit:
    """The fit after a Gauss-Newton step, clipped to the bounds and halved until it reduces the cost; else unchanged."""
    information, gradient = normal_equations(bench, base)
    step = -np.linalg.pinv(information, hermitian=True) @ gradient
    low, high = np.array([u.bounds for u in base.unknowns]).T
    for half in range(_HALVINGS + 1):
        x = np.clip(base.values + step / 2**half, low, high)
        [r] = bench.residuals([(*model_and_starts_at(base.model, base.starts, base.unknowns, x), None)])
        there = _fit_at(bench, base, x, r, base.covariance)
        if there.cost < base.cost:
            return there
    return base


def _fit_at(bench: Workbench, base: Fit, x: np.ndarray, r: np.ndarray, covariance: np.ndarray) -> Fit:
    """The fit at other values x (p) with their residual r (n), the Jacobian unchanged."""
    cost = cost_of(bench, base.unknowns, x, r)
    model, starts = model_and_starts_at(base.model, base.starts, base.unknowns, x)
    return Fit(model, starts, base.unknowns, x, covariance, r, bench.sizes(r), cost, base.jacobian)
