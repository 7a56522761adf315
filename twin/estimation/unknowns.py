"""Unknowns of a fit: declared and effect parameters, command clock, errors of channels, initial states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from twin.effects import REGISTRY
from twin.effects.base import TIMING_TOLERANCE
from twin.mechanics.state import Start
from twin.parameters import declared_range, relative_uncertainty
from twin.recording import LONGEST_DELAY
from twin.residuals.prepared import Prepared, shortest_period
from twin.residuals.significance import SIGNIFICANT
from twin.rigs.channel_errors import COMMAND, ChannelErrors, replaced_errors
from twin.rigs.model import Model

_NOT_FITTED = ("torque_limit",)  # declared parameters that are known exactly: a setting of the amplifier
_ANY = -np.inf, np.inf

Kind = Literal["rig", "effect", "clock", "gain", "delay", "start"]
Key = tuple[Kind, str, str, int | None, int | None]


@dataclass(frozen=True)
class Unknown:
    """One scalar that a fit may change.

    Attributes:
      kind: "rig" for a declared parameter, "effect" for a parameter of an effect, "clock" for the delay of the
        commands, "gain" and "delay" for the errors of a channel, "start" for the state of one recording at its first
        sample.
      name: of the parameter; for "clock" the attribute of `Model`, for "gain" and "delay" the channel, for "start" the
        attribute of `Start`.
      start: initial value, and mean of the prior if there is one.
      scale: standard deviation of the prior; without a prior, a small change that is visible in the residual.
      prior: whether there is a Gaussian prior.
      bounds: lower and upper limit.
      recording: index of the recording for "start", otherwise None.
      effect: name of the effect for "effect", otherwise empty.
      index: element of the attribute where that is a pair, otherwise None.
      inverse: whether the scalar is the reciprocal of the parameter.
    """

    kind: Kind
    name: str
    start: float
    scale: float
    prior: bool
    bounds: tuple[float, float]
    recording: int | None = None
    effect: str = ""
    index: int | None = None
    inverse: bool = False

    @property
    def key(self) -> Key:
        """Identifier that no other unknown of the same fit has."""
        return self.kind, self.effect, self.name, self.recording, self.index

    @property
    def is_parameter(self) -> bool:
        """Whether it is a parameter of the rig or of an effect, as opposed to nuisance parameters and first states."""
        return self.kind in ("rig", "effect")

    @property
    def is_nuisance(self) -> bool:
        """Whether it is an error of clock or channels, which is fitted beside every effect."""
        return self.kind in ("clock", "gain", "delay")

    @property
    def is_channel_error(self) -> bool:
        """Whether it is the gain or the delay of a channel, within its declared uncertainty."""
        return self.kind in ("gain", "delay")

    @property
    def full_name(self) -> str:
        """Name of a parameter in the correlations of a parameter file: `parameter` or `effect.parameter`."""
        return f"{self.effect}.{self.name}" if self.effect else self.name

    def turned(self, value: float) -> float:
        """Converts the fitted scalar to the parameter's value, or the value to the scalar."""
        if not self.inverse:
            return value
        return 1 / value if value else math.inf


def replaced_parameters(model: Model) -> set[str]:
    """Declared parameters that an effect of the model replaces by its own."""
    return {p for name in model.effects for p in REGISTRY[name].replaces}


def unit_of(unknown: Unknown, model: Model) -> str:
    """SI unit of a parameter of the rig or of an effect."""
    if unknown.kind == "rig":
        return model.declared.parameters[unknown.name].unit
    return REGISTRY[unknown.effect].units(model.effects[unknown.effect])[unknown.name]


def declared_unknowns(model: Model) -> list[Unknown]:
    """Declared parameters with a non-zero uncertainty, which is the deviation of a Gaussian prior."""
    unknowns, replaced = [], replaced_parameters(model)
    for name, parameter in model.declared.parameters.items():
        relative = relative_uncertainty(parameter)
        scale = relative * abs(parameter.value)
        if name not in _NOT_FITTED and name not in replaced and scale > 0:
            # Calibration stays within the declared uncertainty; a larger change is a missing effect.
            bounds = declared_range(parameter, SIGNIFICANT)
            unknowns.append(Unknown("rig", name, parameter.value, scale, True, bounds))
    return unknowns


def clock_unknown(prepared: Sequence[Prepared]) -> Unknown:
    """Delay of the commands against their time stamps, `Model.late` [s]: a nuisance parameter.

    No campaign declares it to a tenth of a sample. An effect such as a dead time can look like it, so it is fitted
    together with every candidate.
    """
    limit = TIMING_TOLERANCE * shortest_period(prepared)
    return Unknown("clock", "late", 0.0, limit / 2, True, (-limit, limit))


def channel_unknowns(model: Model, channels: set[str]) -> list[Unknown]:
    """Gain and delay of each of these channels, and of the command, whose uncertainty is declared.

    The prior is that declaration, about a gain of 1 and no delay. As of a declared parameter, a fit stays within
    `SIGNIFICANT` standard deviations of it: what is left beyond is an effect.
    """
    unknowns = []
    for name, sensor in model.sensors.items():
        if name not in channels and name != COMMAND:
            continue
        if (relative := sensor.gain_uncertainty) > 0:
            factor = math.exp(SIGNIFICANT * relative)
            unknowns.append(Unknown("gain", name, 1.0, relative, True, (1 / factor, factor)))
        if (deviation := sensor.delay_uncertainty) > 0:
            limit = min(SIGNIFICANT * deviation, LONGEST_DELAY)
            unknowns.append(Unknown("delay", name, 0.0, deviation, True, (-limit, limit)))
    replaced = replaced_errors(model.effects)
    return [u for u in unknowns if (u.kind, u.name) not in replaced]


def effect_unknowns(effect: str, values: Mapping[str, float], channels: set[str]) -> list[Unknown]:
    """Parameters of an effect, without a prior, that a fit to these channels can determine."""
    return [
        Unknown(
            "effect",
            p.name,
            p.turned(values[p.name]),
            abs(p.step),
            False,
            p.span,
            None,
            effect,
            None,
            p.inverse,
        )
        for p in REGISTRY[effect].free_parameters(values)
        if p.channel is None or p.channel in channels
    ]


def known_effect_unknowns(
    model: Model, errors: Mapping[str, Mapping[str, float]], channels: set[str]
) -> list[Unknown]:
    """Parameters of the effects that the rig is declared with.

    Args:
      model: the declared model.
      errors: effect -> parameter -> standard error. A positive one becomes the deviation of a Gaussian prior; 0 fixes
        the parameter; without one the parameter has no prior.
      channels: channels that are compared.
    """
    unknowns = []
    for effect, values in model.effects.items():
        for u in effect_unknowns(effect, values, channels):
            error = errors.get(effect, {}).get(u.name)
            if error is None:
                unknowns.append(u)
            elif error > 0:
                scale = error * u.start**2 if u.inverse else error
                unknowns.append(replace(u, scale=scale, prior=True))
    return unknowns


def start_unknowns(prepared: Sequence[Prepared]) -> list[Unknown]:
    """Initial state of every recording that did not start at rest: hub angle and rate, two modes and their rates."""
    unknowns = []
    for i, p in enumerate(prepared):
        if p.recording.start != "unknown":
            continue
        if p.hub is not None:
            angle, rate = p.noise["hub_angle"], 30 * p.noise["hub_angle"]
            unknowns.append(Unknown("start", "hub_angle", p.start.hub_angle, angle, False, _ANY, i))
            unknowns.append(Unknown("start", "hub_rate", p.start.hub_rate, rate, False, _ANY, i))
        for mode in (0, 1):
            bend, rate = p.start.bend[mode], p.start.bend_rate[mode]
            unknowns.append(Unknown("start", "bend", bend, 1e-4, False, (-1.0, 1.0), i, index=mode))
            unknowns.append(Unknown("start", "bend_rate", rate, 1e-2, False, _ANY, i, index=mode))
    return unknowns


def model_at(model: Model, unknowns: Sequence[Unknown], values: np.ndarray) -> Model:
    """The model with its parameters at these values (p) of the unknowns."""
    rig, clock = dict[str, float](), dict[str, float]()
    errors = {"gain": dict(model.channel_errors.gains), "delay": dict(model.channel_errors.delays)}
    effects = {name: dict(p) for name, p in model.effects.items()}
    for u, v in zip(unknowns, values, strict=True):
        if u.kind == "rig":
            rig[u.name] = float(v)
        elif u.kind == "clock":
            clock[u.name] = float(v)
        elif u.kind in errors:
            errors[u.kind][u.name] = float(v)
        elif u.effect in effects:
            effects[u.effect][u.name] = u.turned(float(v))
    declared = model.declared.replace(source="fitted", **rig) if rig else model.declared
    of_channels = ChannelErrors(errors["gain"], errors["delay"])
    return model.replace(declared=declared, effects=effects, channel_errors=of_channels, **clock)


def starts_at(starts: Sequence[Start], unknowns: Sequence[Unknown], values: np.ndarray) -> tuple[Start, ...]:
    """The initial states, one per recording, at these values (p) of the unknowns."""
    changed = list(starts)
    for u, v in zip(unknowns, values, strict=True):
        if u.kind == "start" and u.recording is not None:
            changed[u.recording] = _with_value(changed[u.recording], u.name, u.index, float(v))
    return tuple(changed)


def _with_value(start: Start, name: str, index: int | None, value: float) -> Start:
    """The state with one attribute, or one element of a pair, set."""
    attribute: Any = value
    if index is not None:
        pair = list(getattr(start, name))
        pair[index] = value
        attribute = tuple(pair)
    return replace(start, **{name: attribute})


def model_and_starts_at(
    model: Model, starts: Sequence[Start], unknowns: Sequence[Unknown], x: np.ndarray
) -> tuple[Model, tuple[Start, ...]]:
    """The model and the initial states at values x (p) of the unknowns."""
    return model_at(model, unknowns, x), starts_at(starts, unknowns, x)
