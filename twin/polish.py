"""The last fit: whole recordings, simulated with every stick and slip, from where the search left off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin import breakaway, chain, fit, search
from twin.fit import Fit, GuidedData, Prepared, Unknown, Workbench
from twin.model import Model, Start

_ITERATIONS = 4
_SEGMENTS, _STEP = 6, 1e-3
_SPANS = (0.06, 0.005)  # a break-away that is off by 0.1 % can decide the rest of a run
_SCAN = 25  # values of a break-away torque tried over a span
_GAPS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)  # parts of a play that whole runs are tried with
_LIKELY = 2.0  # log likelihood below the best up to which a value is within two standard errors
_LEVELS = ("static_friction", "static_positive", "static_negative")


@dataclass(frozen=True)
class Polished:
    """The three models of a report.

    Attributes:
      declared: as declared.
      calibrated: declared parameters refitted within their uncertainty.
      augmented: with the adopted effects; the same as `calibrated` where there are none.
      bench: what they were fitted on.
    """

    declared: Model
    calibrated: Fit
    augmented: Fit
    bench: Workbench


def polish(
    prepared: Sequence[Prepared], base: Fit, best: Fit, declared: Model, pool: ThreadPoolExecutor, whole: bool
) -> Polished:
    """Fits the model that the search came to once more, on the whole recordings.

    Without `whole`, the models stay as the search left them, but for their break-away torque: one that does not
    follow the recordings gains nothing from their whole length. One with a play is not fitted to it either: its impacts
    take ten times as many steps, and whole runs hang on each of them as on a stick.
    """
    bench = Workbench(GuidedData(prepared), pool)
    if not whole:
        augmented = _with_break_away(bench, best)
    elif best.model.plant.gap > 0:
        augmented = _with_break_away(bench, _between_gaps(bench, best))
    else:
        augmented = _polished(bench, best)
    calibrated = augmented if best is base else _with_break_away(bench, base)
    return Polished(declared, calibrated, augmented, bench)


def _polished(bench: Workbench, best: Fit) -> Fit:
    shape = chain.fit_shape(best.model.rig, _SEGMENTS)
    model, starts, unknowns = best.model.replace(shape=shape, step=_STEP), best.starts, best.unknowns
    x = best.values
    # Two views of the break-away torque: of the search, and read at the instants at which rests end.
    views = [x, _read_levels(bench, best, x)]
    x = views[int(np.argmin(fit.costs(bench, model, starts, unknowns, views)))]
    placed = fit.placed(model, unknowns, x)
    bench.refine(placed, search.fine(placed), starts)
    free = Workbench(fit.FreeData(bench.prepared), bench.pool)
    x, _ = _scanned(free, model, starts, unknowns, x, _SPANS)
    result = fit.minimise(bench, model, starts, unknowns, x, None, _ITERATIONS)
    # A rig that the chain follows only roughly may lead the whole runs astray: then the search knew better.
    before = fit.costs(bench, model, best.starts, unknowns, [best.values])[0]
    if not result.cost < before:
        return _with_break_away(bench, best)
    result = _with_disagreement(result, best)
    x, errors = _scanned(free, result.model, result.starts, unknowns, result.values, _SPANS[1:])
    return _with_levels(result, x, errors)


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


def _scanned(
    free: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    x: np.ndarray,
    spans: Sequence[float],
) -> tuple[np.ndarray, dict[int, float]]:
    """The point (p) with its break-away torques at the best of grids, the recordings simulated freely; their errors.

    Whether a run that nothing guides sticks and slips as the measured one did is what a break-away torque decides:
    it says more of it than the few instants at which the hub was seen to leave a rest.
    """
    errors: dict[int, float] = {}
    for index, unknown in enumerate(unknowns):
        if unknown.name not in _LEVELS:
            continue
        for span in spans:
            values = x[index] * np.linspace(1 - span, 1 + span, _SCAN)
            points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
            cost = fit.costs(free, model, starts, unknowns, points)
            x = points[int(np.argmin(cost))]
            likely = values[cost < cost.min() + _LIKELY]
            errors[index] = max(np.ptp(likely) / 4, values[1] - values[0])
    return x, errors


def _with_levels(result: Fit, x: np.ndarray, errors: Mapping[int, float]) -> Fit:
    """The fit with break-away torques and their errors as the free runs have them."""
    covariance = result.covariance.copy()
    for index, error in errors.items():
        covariance[index, :] = covariance[:, index] = 0.0
        covariance[index, index] = error**2
    model = fit.placed(result.model, result.unknowns, x)
    return replace(result, model=model, values=x, covariance=covariance)


def _with_disagreement(result: Fit, other: Fit) -> Fit:
    """The fit with half its distance to another kind of fit added to its errors.

    A stick or slip makes whole runs steep in every parameter, so that noise alone promises too much.
    """
    apart = (result.values - other.values) / 2
    return replace(result, covariance=result.covariance + np.diag(apart**2))


def _with_break_away(bench: Workbench, base: Fit) -> Fit:
    """A fit with its break-away torque read from the recordings, nothing else changed."""
    x = _read_levels(bench, base, base.values)
    model = fit.placed(base.model, base.unknowns, x)
    return Fit(
        model,
        base.starts,
        base.unknowns,
        x,
        base.covariance,
        base.residual,
        base.size,
        base.cost,
        base.jacobian,
    )


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
