"""The last fit: static friction, which whole runs hang on.

The link under the measured hub, on which the search works, says all else better than whole runs do: no stick or slip
of a simulation enters there, nor the error of a chain that is short enough to be run so often. A run that nothing
guides, though, is decided by the static levels to within some parts in ten thousand. They are read where rests end;
where no recording shows that, they are those with which whole runs keep closest to the recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import costs_at
from twin.estimation.unknowns import placed_both
from twin.estimation.workbench import FreeData, Workbench
from twin.mechanics import chain
from twin.residuals import breakaway, static_levels
from twin.residuals.data import DrivenData
from twin.residuals.static_levels import Level
from twin.rigs.model import Model

_SEGMENTS, _STEP = 6, 1e-3
_LIKELY = 2.0  # log likelihood below the best up to which a value is within two standard errors
_STATIC = {"static_friction": (1, -1), "static_positive": (1,), "static_negative": (-1,)}
"""Static levels, and the directions that each is one of."""
_SCANS = ((0.06, 25), (0.006, 25), (0.001, 11))
"""How far either way a level of which next to nothing is known is looked for (a part of it), and how many are tried."""


@dataclass(frozen=True)
class Polished:
    """The three models of a report.

    Attributes:
      declared: as declared.
      calibrated: declared parameters refitted within their uncertainty.
      augmented: with the adopted effects; the same as `calibrated` where there are none.
    """

    declared: Model
    calibrated: Fit
    augmented: Fit


def polish(
    data: DrivenData, base: Fit, best: Fit, declared: Model, pool: ThreadPoolExecutor, whole: bool
) -> Polished:
    """Reads the static friction of the model that the search came to, and what else whole recordings tell.

    Without `whole`, nothing is told by whole runs: those of a model that does not follow the recordings tell nothing.
    Nor do those of one with a play: its impacts take ten times as many steps, and whole runs hang on each of them.
    """
    told = whole and best.model.plant.motor.gap <= 0
    augmented = with_static_levels(data, best, pool if told else None)
    calibrated = augmented if best is base else with_static_levels(data, base)
    return Polished(declared, calibrated, augmented)


def with_static_levels(data: DrivenData, best: Fit, pool: ThreadPoolExecutor | None = None) -> Fit:
    """The fit with its static levels read; with a pool, those that no rest tells are looked for by whole runs."""
    read, rough = _read_levels(data, best)
    best = _moved_along(best, read)
    x, covariance, errors = best.values.copy(), best.covariance.copy(), dict[int, float]()
    x[list(rough)] = list(rough.values())
    if pool is not None and (free := Workbench(FreeData(data.prepared), pool)).count.any():
        x = _scanned(free, best, x, list(rough), errors)
    for index, error in errors.items():
        covariance[index, :] = covariance[:, index] = 0.0
        covariance[index, index] = error**2
    model, starts = placed_both(best.model, best.starts, best.unknowns, x)
    return replace(best, model=model, starts=starts, values=x, covariance=covariance)


def _moved_along(best: Fit, levels: Mapping[int, Level]) -> Fit:
    """The fit with levels as they are read, and the other values as likely as they are beside these.

    A friction that falls from its static level with the speed is fitted together with it: known better from elsewhere,
    the level takes the speed along. A reading that says less than the fit takes nothing along.
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


def _read_levels(data: DrivenData, result: Fit) -> tuple[dict[int, Level], dict[int, float]]:
    """Static levels among the unknowns of a fit, by their places: as rests tell them, and about where others are."""
    read = static_levels.levels(data, result.model, result.starts)
    known, about = dict[int, Level](), dict[int, float]()
    for j, u in enumerate(result.unknowns):
        asked = _STATIC.get(u.name, ())
        seen = [read[d] for d in asked if d in read]
        if seen:
            known[j] = static_levels.together(seen)
        elif asked:
            rough = breakaway.levels(breakaway.find(result.model, data.prepared, result.starts))
            level = max((rough[d] for d in asked if d in rough), default=result.values[j])
            about[j] = float(np.clip(level, *u.bounds))
    return known, about


def _scanned(
    free: Workbench, best: Fit, x: np.ndarray, indices: Sequence[int], errors: dict[int, float]
) -> np.ndarray:
    """The point (p) with some values at the best of ever finer grids, the recordings simulated freely.

    Each time, the one that brings the runs closest first: others would make up for it. Their `errors` are noted.
    """
    model = best.model.replace(shape=chain.fit_shape(best.model.rig, _SEGMENTS), step=_STEP)
    for reach, count in _SCANS:
        open_yet = list(indices)
        while open_yet:
            tries = {k: _best_of_grid(free, model, best, x, k, reach, count) for k in open_yet}
            chosen = min(tries, key=lambda k: tries[k][2])
            x, errors[chosen], _ = tries[chosen]
            open_yet.remove(chosen)
    return x


def _best_of_grid(
    free: Workbench, model: Model, best: Fit, x: np.ndarray, index: int, reach: float, count: int
) -> tuple[np.ndarray, float, float]:
    """The best point (p) of a grid of one value, the error of that value, and what the point costs."""
    half = reach * abs(x[index])
    values = np.clip(x[index] + np.linspace(-half, half, count), *best.unknowns[index].bounds)
    points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
    cost = costs_at(free, model, best.starts, best.unknowns, points)
    likely = values[cost < cost.min() + _LIKELY]
    error = max(float(np.ptp(likely)) / 4, 2 * half / (count - 1))
    return points[int(np.argmin(cost))], error, float(cost.min())
