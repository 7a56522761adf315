"""What the fit of a model with other effects begins with: its unknowns and their first values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.slopes import cost_of
from twin.estimation.unknowns import (
    Unknown,
    effect_unknowns,
    model_and_starts_at,
    replaced_parameters,
    unit_of,
)
from twin.estimation.workbench import Workbench
from twin.rigs.channel_errors import replaced_errors
from twin.rigs.model import Model


def without_replaced_errors(model: Model) -> Model:
    """The model without errors of channels that its effects are."""
    return model.replace(channel_errors=model.channel_errors.without(replaced_errors(model.effects)))


def fit_unknowns(bench: Workbench, model: Model, base: Fit) -> tuple[Unknown, ...]:
    """Unknowns of a fit: declared parameters that no effect replaces, nuisances, effect parameters, first states.

    Those of an effect that the base has are the base's: a declared effect keeps its uncertainty.
    """
    replaced = replaced_parameters(model)
    kept = [u for u in base.unknowns if u.kind == "rig" and u.name not in replaced]
    errors = replaced_errors(model.effects)
    kept += [u for u in base.unknowns if u.is_nuisance and (u.kind, u.name) not in errors]
    starts = [u for u in base.unknowns if u.kind == "start"]
    effects = [
        u
        for name, values in model.effects.items()
        for u in (
            [u for u in base.unknowns if u.effect == name]
            if name in base.model.effects
            else effect_unknowns(name, values, bench.channels())
        )
    ]
    return (*kept, *effects, *starts)


def initial_values(unknowns: Sequence[Unknown], model: Model, *fits: Fit) -> np.ndarray:
    """First values (p) of a fit: of effects as in the model, of all else as in the last of these fits that has them."""
    known = {u.key: v for f in fits for u, v in zip(f.unknowns, f.values, strict=True)}
    first = []
    for u in unknowns:
        value = known.get(u.key, u.start)
        first.append(u.turned(model.effects[u.effect][u.name]) if u.effect in model.effects else value)
    return np.array(first)


def initial_values_near(
    bench: Workbench, unknowns: Sequence[Unknown], model: Model, base: Fit, near: Fit
) -> np.ndarray:
    """First values (p) of the fit of a model that may lack effects of a fit near it.

    Others may take their place (`Effect.taken_over`), where a descent from the values beside them would not lead: they
    are moved if this costs less.

    Args:
      bench: the data.
      unknowns: (p).
      model: to be fitted.
      base, near: the fits whose values are taken, as by `initial_values`.
    """
    first = initial_values(unknowns, model, base, near)
    moved = first
    for name, values in near.model.effects.items():
        if name not in model.effects:
            moved = _taken_over(name, values, unknowns, moved, model)
    if np.array_equal(moved, first):
        return first
    points = first, moved
    jobs = [(*model_and_starts_at(model, near.starts, unknowns, x), None) for x in points]
    costs = [cost_of(bench, unknowns, x, r) for x, r in zip(points, bench.residuals(jobs), strict=True)]
    return points[int(np.argmin(costs))]


def _taken_over(
    name: str, values: Mapping[str, float], unknowns: Sequence[Unknown], x: np.ndarray, model: Model
) -> np.ndarray:
    """Values (p) with which other parameters take the place of an effect that has these values."""
    moved = x.copy()
    for k, u in enumerate(unknowns):
        if u.is_parameter:
            other = REGISTRY[name].taken_over(values, u.full_name, u.turned(x[k]), unit_of(u, model))
            moved[k] = np.clip(u.turned(other), *u.bounds)
    return moved
