"""The last fit: what acts on the hub alone, by whole recordings, simulated with every stick and slip.

The link under the measured hub, on which the search works, says all but these better than whole runs do: no stick or
slip of a simulation enters there, nor the error of a chain that is short enough to be run so often. When a run that
nothing guides sticks and slips, though, is decided by the break-away and the Coulomb torque to within a part in a
thousand, so that the levels are those with which such runs keep closest to the recordings. And a small steady torque
on the hub adds up over a whole run: guided ones, in which it rests when the measured hub does, tell its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin import breakaway, chain, driven, fit
from twin.effects import REGISTRY
from twin.effects.base import Effect
from twin.fit import Fit, GuidedData, Prepared, Unknown, Workbench
from twin.model import Model

_SEGMENTS, _STEP, _ITERATIONS = 6, 1e-3, 4
_FARTHEST = 3.0  # standard errors of the search within which whole runs may move what acts on the hub
_GAPS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)  # parts of a play that whole runs are tried with
_LIKELY = 2.0  # log likelihood below the best up to which a value is within two standard errors
_STATIC = ("static_friction", "static_positive", "static_negative")
_COULOMB = ("coulomb_friction", "coulomb_positive", "coulomb_negative")
_SCANS: tuple[tuple[tuple[str, ...], float, int], ...] = (
    (_STATIC, 0.06, 25),
    (_STATIC, 0.006, 25),
    (_COULOMB, 0.05, 21),
    (_STATIC, 0.001, 11),
    (_COULOMB, 0.006, 9),
)
"""Levels, how far either way (a part of the level), and how many values are tried.

A static level that is a part in a thousand off makes other sticks, and among these a Coulomb torque tells little: it is
looked for where the static levels are known to half a part in a thousand.
"""


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
    prepared: Sequence[Prepared], base: Fit, best: Fit, declared: Model, pool: ThreadPoolExecutor, whole: bool
) -> Polished:
    """Fits the model that the search came to once more, on the whole recordings.

    Without `whole`, the models stay as the search left them, but for their break-away torque, read where rests end: one
    that does not follow the recordings gains nothing from their whole length. Of one with a play only the gap is looked
    for in it: its impacts take ten times as many steps, and whole runs hang on each of them as on a stick.
    """
    bench = Workbench(GuidedData(prepared), pool)
    if not whole:
        augmented = _with_break_away(bench, best)
    elif best.model.plant.gap > 0:
        augmented = _with_break_away(bench, _between_gaps(bench, best))
    else:
        augmented = _polished(bench, best)
    calibrated = augmented if best is base else _with_break_away(bench, base)
    return Polished(declared, calibrated, augmented)


def _polished(bench: Workbench, best: Fit) -> Fit:
    """The fit with its levels of friction, and other effects on the hub, as whole runs have them.

    Half the distance to the other view of a level counts as error: of a static one, that read where rests end; of all
    else, the search's, whose own error stays.
    """
    model = best.model.replace(shape=chain.fit_shape(best.model.rig, _SEGMENTS), step=_STEP)
    free = Workbench(fit.FreeData(bench.prepared), bench.pool)
    read = _read_levels(bench, best, best.values)
    x, errors = read, dict[int, float]()
    for names, reach, count in _SCANS:
        open_yet = [index for index, unknown in enumerate(best.unknowns) if unknown.name in names]
        # The level that brings the runs closest first: others would make up for it.
        while open_yet:
            tries = [_scanned(free, model, best, x, k, reach, count) for k in open_yet]
            chosen = int(np.argmin([t.cost for t in tries]))
            x, errors[open_yet.pop(chosen)] = tries[chosen].values, tries[chosen].error
    x = _on_whole_runs(bench, model, best, x)
    covariance = best.covariance + np.diag((x - best.values) ** 2 / 4)
    for index, error in errors.items():
        if best.unknowns[index].name in _STATIC:
            covariance[index, :] = covariance[:, index] = 0.0
            covariance[index, index] = error**2 + (x - read)[index] ** 2 / 4
    return replace(best, model=fit.placed(best.model, best.unknowns, x), values=x, covariance=covariance)


def _on_whole_runs(bench: Workbench, model: Model, best: Fit, x: np.ndarray) -> np.ndarray:
    """The point (p) with the effects on the hub alone fitted to the guided runs, Coulomb levels with them.

    A small steady torque adds up over a whole run. The link stays as it is: a short chain would bend it to its error.
    """
    mine = [k for k, u in enumerate(best.unknowns) if u.name not in _STATIC and _on_hub(best.model, u)]
    if all(best.unknowns[k].name in _COULOMB for k in mine):
        return x
    placed = fit.placed(model, best.unknowns, x)
    # Differences over a whole scale look past single sticks, which those within a prior would stumble over.
    unknowns = [replace(best.unknowns[k], prior=False) for k in mine]
    found = fit.minimise(bench, placed, best.starts, unknowns, x[mine], iterations=_ITERATIONS)
    if np.any(np.abs(found.values - best.values[mine]) > _FARTHEST * best.errors[mine]):
        return x
    x = x.copy()
    x[mine] = found.values
    return x


def _on_hub(model: Model, unknown: Unknown) -> bool:
    """Whether a number says something of torques on the hub, and of nothing else."""
    if unknown.owner not in model.effects:
        return unknown.name in _COULOMB
    kind = type(REGISTRY[unknown.owner])
    if any(
        getattr(kind, act) is not getattr(Effect, act) for act in ("rig", "links", "sensing", "hub_angle_of")
    ):
        return False
    without = model.replace(effects={n: p for n, p in model.effects.items() if n != unknown.owner})
    return driven.link_of(model.plant) == driven.link_of(without.plant)


def _between_gaps(bench: Workbench, best: Fit) -> Fit:
    """The fit with its play between those that two views prefer, half their distance added to its error.

    A hub that follows its filtered reading gives way to an impact too slowly, which makes the play look wide; a whole
    run has the impacts of its own motion, not always those of the rig.
    """
    index = next(j for j, u in enumerate(best.unknowns) if u.name == "gap")
    model = best.model.replace(shape=chain.fit_shape(best.model.rig, _SEGMENTS), step=_STEP)
    gaps = best.values[index] * np.array(_GAPS)
    points = [np.r_[best.values[:index], gap, best.values[index + 1 :]] for gap in gaps]
    cost = fit.costs(bench, model, best.starts, best.unknowns, points)
    apart = (gaps[int(np.argmin(cost))] - best.values[index]) / 2
    x, covariance = best.values.copy(), best.covariance.copy()
    x[index] += apart
    covariance[index, index] += apart**2
    return replace(best, model=fit.placed(best.model, best.unknowns, x), values=x, covariance=covariance)


@dataclass(frozen=True)
class _Scanned:
    """A point (p) with one value at the best of a grid, the error of that value, and what the point costs."""

    values: np.ndarray
    error: float
    cost: float


def _scanned(
    free: Workbench, model: Model, best: Fit, x: np.ndarray, index: int, reach: float, count: int
) -> _Scanned:
    """Tries a grid of one value about a point (p), the recordings simulated freely."""
    half = reach * abs(x[index])
    values = np.clip(x[index] + np.linspace(-half, half, count), *best.unknowns[index].bounds)
    points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
    cost = fit.costs(free, model, best.starts, best.unknowns, points)
    likely = values[cost < cost.min() + _LIKELY]
    error = max(float(np.ptp(likely)) / 4, 2 * half / (count - 1))
    return _Scanned(points[int(np.argmin(cost))], error, float(cost.min()))


def _with_break_away(bench: Workbench, base: Fit) -> Fit:
    """A fit with its break-away torque read from the recordings, nothing else changed."""
    x = _read_levels(bench, base, base.values)
    return replace(base, model=fit.placed(base.model, base.unknowns, x), values=x)


def _read_levels(bench: Workbench, result: Fit, x: np.ndarray) -> np.ndarray:
    events = breakaway.find(result.model, bench.prepared, result.starts)
    levels = breakaway.levels(events)
    x = x.copy()
    for j, u in enumerate(result.unknowns):
        if u.name == "static_friction" and levels:
            x[j] = np.clip(max(levels.values()), *u.bounds)
        for name, direction in (("static_positive", 1), ("static_negative", -1)):
            if u.name == name and direction in levels:
                x[j] = np.clip(levels[direction], *u.bounds)
    return x
