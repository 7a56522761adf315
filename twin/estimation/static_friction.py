"""Static friction levels of a fitted model, from break-aways or from free-running simulations.

The data of the search (link driven by the measured hub angle) determine everything else better than free-running
simulations do: no stick or slip of a simulation enters them, nor the discretisation error of a chain that is short
enough for many runs. But a free-running simulation depends on the static levels to some parts in ten thousand. They are
read from the ends of rests under a slowly growing torque. Where no recording has one, a grid search finds the levels
whose free-running simulations are closest to the recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.slopes import costs_at
from twin.estimation.unknowns import model_and_starts_at
from twin.estimation.workbench import FreeData, Workbench
from twin.residuals import static_levels
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID
from twin.residuals.static_levels import TWO_SIGMA, Level
from twin.rigs.model import Model

_DIRECTIONS = {"static_friction": (1, -1), "static_positive": (1,), "static_negative": (-1,)}
"""Static level -> directions of motion in which it acts."""
_GRIDS = ((0.06, 25), (0.006, 25), (0.001, 11))
"""Successive grids of the search: half width relative to the level, and number of points."""


@dataclass(frozen=True)
class FinalModels:
    """The models that a diagnosis reports.

    Attributes:
      declared: as declared.
      calibrated: declared parameters refitted within their uncertainty.
      augmented: with the adopted effects; the same as `calibrated` if there are none.
    """

    declared: Model
    calibrated: Fit
    augmented: Fit


def final_models(
    data: DrivenData, base: Fit, best: Fit, declared: Model, pool: ResidualPool, whole: bool
) -> FinalModels:
    """The final models with their static friction levels.

    Args:
      data: the fit recordings.
      base: the calibrated model.
      best: the model with the adopted effects; `base` itself if there are none.
      declared: the declared model.
      pool: where residuals are computed.
      whole: whether free-running simulations may be used. Those of a model that does not follow the recordings carry no
        information on friction. They are never used with a backlash: its impacts take ten times as many steps, and a
        free run depends on each of them.
    """
    use_free_runs = whole and best.model.plant.motor.gap <= 0
    augmented = with_static_levels(data, best, pool if use_free_runs else None)
    calibrated = augmented if best is base else with_static_levels(data, base)
    return FinalModels(declared, calibrated, augmented)


def with_static_levels(data: DrivenData, best: Fit, pool: ResidualPool | None = None) -> Fit:
    """The fit with its static levels from break-aways; with a pool, the others from free-running simulations."""
    read, others = _read_levels(data, best)
    best = _conditioned(best, read)
    x, covariance, errors = best.values.copy(), best.covariance.copy(), dict[int, float]()
    if pool is not None and (free := Workbench(FreeData(data.prepared), pool)).count.any():
        x = _grid_search(free, best, x, others, errors)
    for index, error in errors.items():
        covariance[index, :] = covariance[:, index] = 0.0
        covariance[index, index] = error**2
    model, starts = model_and_starts_at(best.model, best.starts, best.unknowns, x)
    return replace(best, model=model, starts=starts, values=x, covariance=covariance)


def _conditioned(best: Fit, levels: Mapping[int, Level]) -> Fit:
    """The fit with static levels set to readings (index of the unknown -> level).

    If a reading is more accurate than the fit, all values and their covariance are conditioned on it (the speed at
    which a Stribeck friction falls is correlated with the level). Otherwise the other values stay as they are, and the
    level becomes uncorrelated with them.
    """
    x, covariance = best.values.copy(), best.covariance.copy()
    for k, level in levels.items():
        variance, read = covariance[k, k], level.error**2
        if read < variance:
            along = covariance[:, k] / variance
            x += along * (level.value - x[k])
            covariance -= np.outer(along, along) * (variance - read)
        else:
            covariance[k, :] = covariance[:, k] = 0.0
            covariance[k, k] = read
        x[k] = level.value
    x = np.clip(x, *np.transpose([u.bounds for u in best.unknowns]))
    return replace(best, values=x, covariance=covariance)


def _read_levels(data: DrivenData, base: Fit) -> tuple[dict[int, Level], list[int]]:
    """Static levels read from break-aways, by index of the unknown, and the indices of the other static levels."""
    read = static_levels.levels(data, base.model, base.starts)
    known, others = dict[int, Level](), list[int]()
    for j, u in enumerate(base.unknowns):
        directions = _DIRECTIONS.get(u.name, ())
        levels = [read[d] for d in directions if d in read]
        if levels:
            known[j] = static_levels.combined_level(levels)
        elif directions:
            others.append(j)
    return known, others


def _grid_search(
    free: Workbench, best: Fit, x: np.ndarray, indices: Sequence[int], errors: dict[int, float]
) -> np.ndarray:
    """Values (p) with some of them at the minimum of successive grids of free-running simulations.

    On each grid the unknowns are set one after the other, always the one that reduces the cost most: otherwise another
    one would compensate for it. A grid that is as likely throughout leaves the error that a wider one told.

    Args:
      free: the data.
      best: the fit.
      x: first values (p).
      indices: of the unknowns to search for.
      errors: receives their standard errors, by index.
    """
    model = best.model.replace(step=GRID / 2)
    for reach, count in _GRIDS:
        remaining = list(indices)
        while remaining:
            trials = {k: _best_of_grid(free, model, best, x, k, reach, count) for k in remaining}
            chosen = min(trials, key=lambda k: trials[k][2])
            x, error, _ = trials[chosen]
            errors[chosen] = errors.get(chosen, reach * abs(x[chosen]) / 2) if error is None else error
            remaining.remove(chosen)
    return x


def _best_of_grid(
    free: Workbench, model: Model, best: Fit, x: np.ndarray, index: int, reach: float, count: int
) -> tuple[np.ndarray, float | None, float]:
    """The best point (p) of a grid in one unknown, the standard error of that unknown, and the cost at the point.

    Of points that are as good it is the nearest to the present one. No error is told where all are likely.
    """
    half = reach * abs(x[index])
    values = np.clip(x[index] + np.linspace(-half, half, count), *best.unknowns[index].bounds)
    points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
    cost = costs_at(free, model, best.starts, best.unknowns, points)
    likely = values[cost < cost.min() + TWO_SIGMA]
    error = max(float(np.ptp(likely)) / 4, 2 * half / (count - 1))
    chosen = np.lexsort((np.abs(values - x[index]), cost))[0]
    return points[chosen], None if len(likely) == count else error, float(cost[chosen])
