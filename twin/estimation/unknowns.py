"""What a fit may move: declared parameters within their uncertainty, effects freely, the first states of recordings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects import REGISTRY
from twin.effects.base import TIMING_TOLERANCE
from twin.mechanics.state import Start
from twin.parameters import declared_range, relative_uncertainty
from twin.residuals.prepared import Prepared, shortest_period
from twin.rigs.model import Model

_REACH = 3.0  # standard deviations by which a declared parameter may be off
_RIGID = ("torque_limit",)
Key = tuple[str, str, int | None]


@dataclass(frozen=True)
class Unknown:
    """One number that a fit may move.

    Attributes:
      owner: effect name, "rig", "clock", or "start" for the state at the first sample of one recording.
      name: parameter.
      start: first value.
      scale: prior standard deviation for a declared parameter, else a small but visible size.
      prior: whether `scale` is a prior about `start`.
      bounds: range.
      recording: index of the only recording that it acts on, or None.
      inverse: whether the number is one over the parameter's value.
    """

    owner: str
    name: str
    start: float
    scale: float
    prior: bool
    bounds: tuple[float, float]
    recording: int | None = None
    inverse: bool = False

    @property
    def key(self) -> Key:
        """What tells it from all others of a fit: each recording has first states of its own."""
        return self.owner, self.name, self.recording

    @property
    def of_rig(self) -> bool:
        """Whether it is a parameter of the rig or of its effects, and not of one recording or of the card."""
        return self.owner not in ("clock", "start")

    @property
    def full_name(self) -> str:
        """The parameter as a parameter file names it in its correlations: those of effects by effect.parameter."""
        return self.name if self.owner == "rig" else f"{self.owner}.{self.name}"

    def turned(self, value: float) -> float:
        """The parameter's value for the number that a fit moves, and the other way round."""
        if not self.inverse:
            return value
        return 1 / value if value else math.inf


def replaced_parameters(model: Model) -> set[str]:
    """Declared parameters that a model's effects take over."""
    return {p for name in model.effects for p in REGISTRY[name].replaces}


def declared_unknowns(model: Model) -> list[Unknown]:
    """Declared parameters that may move within their uncertainty."""
    found, gone = [], replaced_parameters(model)
    for name, parameter in model.declared.parameters.items():
        relative = relative_uncertainty(parameter)
        scale = relative * abs(parameter.value)
        if name not in _RIGID and name not in gone and scale > 0:
            # Within the uncertainty: what would have to move further is not calibration.
            bounds = declared_range(parameter, _REACH)
            found.append(Unknown("rig", name, parameter.value, scale, True, bounds))
    return found


def clock_unknown(prepared: Sequence[Prepared]) -> Unknown:
    """When within a sample a card puts its commands out: nobody declares that to a tenth of a sample.

    Nothing that the model lacks follows from it. An effect may look like it, so that it stays open beside all of them.
    """
    most = TIMING_TOLERANCE * shortest_period(prepared)
    return Unknown("clock", "late", 0.0, most / 2, True, (-most, most))


def effect_unknowns(model: Model, effect: str, values: Mapping[str, float], seen: set[str]) -> list[Unknown]:
    """Parameters of an effect that these channels can say something about."""
    return [
        Unknown(effect, p.name, p.turned(values[p.name]), abs(p.step), False, p.span, inverse=p.inverse)
        for p in REGISTRY[effect].free_parameters(values)
        if p.channel is None or p.channel in seen
    ]


def known_effect_unknowns(
    model: Model, errors: Mapping[str, Mapping[str, float]], seen: set[str]
) -> list[Unknown]:
    """Parameters of the effects that a model begins with; those with a standard error (effect -> name) have a prior."""
    found = []
    for effect, values in model.effects.items():
        for u in effect_unknowns(model, effect, values, seen):
            error = errors.get(effect, {}).get(u.name)
            if error is None:
                found.append(u)
            elif error > 0:
                scale = error * u.start**2 if u.inverse else error
                found.append(replace(u, scale=scale, prior=True))
    return found


def placed(model: Model, unknowns: Sequence[Unknown], values: np.ndarray) -> Model:
    """The model with the unknowns at these values (p)."""
    rig = {u.name: float(v) for u, v in zip(unknowns, values, strict=True) if u.owner == "rig"}
    effects = {name: dict(p) for name, p in model.effects.items()}
    for u, v in zip(unknowns, values, strict=True):
        if u.owner in effects:
            effects[u.owner][u.name] = u.turned(float(v))
    clock = {u.name: float(v) for u, v in zip(unknowns, values, strict=True) if u.owner == "clock"}
    declared = model.declared.replace(source="fitted", **rig) if rig else model.declared
    return model.replace(declared=declared, effects=effects, **clock)


def placed_starts(
    starts: Sequence[Start], unknowns: Sequence[Unknown], values: np.ndarray
) -> tuple[Start, ...]:
    """The starts with the unknowns at these values (p)."""
    changed = list(starts)
    for u, v in zip(unknowns, values, strict=True):
        if u.owner == "start" and u.recording is not None:
            changed[u.recording] = _moved(changed[u.recording], u.name, float(v))
    return tuple(changed)


def _moved(start: Start, name: str, value: float) -> Start:
    if name == "hub_angle":
        return replace(start, hub_angle=value)
    if name == "hub_rate":
        return replace(start, hub_rate=value)
    attribute, index = name.rsplit("_", 1)
    if attribute == "bend":
        return replace(start, bend=_put(start.bend, int(index), value))
    return replace(start, bend_rate=_put(start.bend_rate, int(index), value))


def _put(pair: tuple[float, float], index: int, value: float) -> tuple[float, float]:
    return (value, pair[1]) if index == 0 else (pair[0], value)


def placed_both(
    model: Model, starts: Sequence[Start], unknowns: Sequence[Unknown], x: np.ndarray
) -> tuple[Model, tuple[Start, ...]]:
    """The model and the first states with the unknowns at some values (p)."""
    return placed(model, unknowns, x), placed_starts(starts, unknowns, x)


def start_unknowns(prepared: Sequence[Prepared]) -> list[Unknown]:
    """State at the first sample of every recording that did not start at rest."""
    found = []
    for i, p in enumerate(prepared):
        if p.recording.start != "unknown":
            continue
        if p.hub is not None:
            angle, rate = p.noise["hub_angle"], 30 * p.noise["hub_angle"]
            found.append(Unknown("start", "hub_angle", p.start.hub_angle, angle, False, (-1e3, 1e3), i))
            found.append(Unknown("start", "hub_rate", p.start.hub_rate, rate, False, (-1e3, 1e3), i))
        for mode in (0, 1):
            found.append(Unknown("start", f"bend_{mode}", p.start.bend[mode], 1e-4, False, (-1.0, 1.0), i))
            found.append(
                Unknown("start", f"bend_rate_{mode}", p.start.bend_rate[mode], 1e-2, False, (-1e2, 1e2), i)
            )
    return found
