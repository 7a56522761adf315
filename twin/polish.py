"""The last fit: whole recordings, simulated with every stick and slip, from where the search left off."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from twin import breakaway, chain, fit, search
from twin.fit import Fit, GuidedData, Prepared, Unknown, Workbench
from twin.model import Model, Start

_ITERATIONS = 4
_SEGMENTS, _STEP = 6, 1e-3
_SPANS = (0.06, 0.005)  # a break-away that is off by 0.1 % can decide the rest of a run
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
    follow the recordings gains nothing from their whole length.
    """
    bench = Workbench(GuidedData(prepared), pool)
    augmented = _polished(bench, best) if whole else _with_break_away(bench, best)
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
    x = _scanned(bench, model, starts, unknowns, x)
    result = fit.minimise(bench, model, starts, unknowns, x, None, _ITERATIONS)
    # A rig that the chain follows only roughly may lead the whole runs astray: then the search knew better.
    before = fit.costs(bench, model, best.starts, unknowns, [best.values])[0]
    if not result.cost < before:
        return _with_break_away(bench, best)
    return _level_last(bench, _with_disagreement(result, best))


def _scanned(
    bench: Workbench, model: Model, starts: Sequence[Start], unknowns: Sequence[Unknown], x: np.ndarray
) -> np.ndarray:
    """The point (p) with its break-away torques at the best of a coarse and of a fine grid."""
    for name in _LEVELS:
        for span in _SPANS:
            x = search.scanned(bench, model, starts, unknowns, x, name, span)
    return x


def _with_disagreement(result: Fit, other: Fit) -> Fit:
    """The fit with half its distance to another kind of fit added to its errors.

    A stick or slip makes whole runs steep in every parameter, so that noise alone promises too much.
    """
    apart = (result.values - other.values) / 2
    return replace(result, covariance=result.covariance + np.diag(apart**2))


def _level_last(bench: Workbench, result: Fit) -> Fit:
    """The fit with its break-away torques at the best of a last, finest grid."""
    x = result.values
    for name in _LEVELS:
        x = search.scanned(bench, result.model, result.starts, result.unknowns, x, name, _SPANS[-1])
    return replace(result, model=fit.placed(result.model, result.unknowns, x), values=x)


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
