"""Rigs that the uncertainty of the parameters allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.correlations import Correlations
from twin.errors import InputError
from twin.parameters import Rig, relative_uncertainty

Effects = Mapping[str, Mapping[str, float]]
INDEPENDENT = Correlations()


@dataclass(frozen=True)
class Unknown:
    """One uncertain number.

    Attributes:
      name: of a rig parameter, or effect.parameter.
      value: believed value, SI.
      deviation: standard deviation, SI.
      bounds: range that is physically possible, SI.
      unit: SI unit.
    """

    name: str
    value: float
    deviation: float
    bounds: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class DrawnRig:
    """One rig of a fleet.

    Attributes:
      number: 0 is the rig as believed, drawn ones count from 1.
      rig: parameters.
      effects: effects that act.
      deviations: name of an unknown -> distance from its believed value in standard deviations.
    """

    number: int
    rig: Rig = field(repr=False)
    effects: Effects = field(repr=False)
    deviations: Mapping[str, float]


@dataclass(frozen=True)
class Believed:
    """What is known of a rig, and how well.

    Attributes:
      rig: parameters, with their relative uncertainty.
      effects: effects that act.
      errors: standard errors of the effects' parameters, SI; those without one are certain.
      together: how the parameters were fitted together.
    """

    rig: Rig
    effects: Effects = field(default_factory=dict)
    errors: Effects = field(default_factory=dict)
    together: Correlations = INDEPENDENT


def declared_by(campaign: Campaign) -> Believed:
    """Returns the rig that a campaign declares; where it leaves an uncertainty unsaid, that of a careful lab."""
    parameters = {
        name: replace(p, uncertainty=relative_uncertainty(p)) for name, p in campaign.rig.parameters.items()
    }
    return Believed(Rig(campaign.name, parameters))


def unknowns(rig: Rig, effects: Effects, errors: Effects | None = None) -> tuple[Unknown, ...]:
    """Returns what is uncertain about a rig.

    Args:
      rig: with the relative uncertainty of its parameters.
      effects: effects that act on it.
      errors: standard errors of the effects' parameters, SI; those without one are certain.

    Raises:
      InputError: an uncertainty is infinite.
    """
    found = []
    for p in rig.parameters.values():
        if p.uncertainty:
            found.append(Unknown(p.name, p.value, p.uncertainty * abs(p.value), p.bounds, p.unit))
    for effect, values in (errors or {}).items():
        found += [_of_effect(effect, name, effects[effect][name], error) for name, error in values.items()]
    endless = [u.name for u in found if not np.isfinite(u.deviation)]
    if endless:
        raise InputError(
            f"the uncertainty of {endless[0]} is infinite; expected a finite one to draw rigs from"
        )
    return tuple(u for u in found if u.deviation > 0)


def draw(
    rig: Rig,
    effects: Effects,
    uncertain: tuple[Unknown, ...],
    count: int,
    seed: int,
    correlations: Correlations = INDEPENDENT,
) -> list[DrawnRig]:
    """Returns the rig as believed and `count` drawn ones: normal, correlated, cut off at the bounds.

    The k-th rig of a seed is the same however many are drawn.
    """
    rigs = [DrawnRig(0, rig, effects, {u.name: 0.0 for u in uncertain})]
    root = correlations.root([u.name for u in uncertain])
    for number in range(1, count + 1):
        normal = root @ np.random.default_rng([seed, number]).standard_normal(len(uncertain))
        values = {u.name: _within(u, z) for u, z in zip(uncertain, normal, strict=True)}
        rigs.append(_changed(number, rig, effects, uncertain, values))
    return rigs


def _of_effect(effect: str, name: str, value: float, error: float) -> Unknown:
    from twin.effects import REGISTRY

    parameter = next(p for p in REGISTRY[effect].parameters if p.name == name)
    return Unknown(f"{effect}.{name}", value, error, parameter.bounds, parameter.unit)


def _within(unknown: Unknown, normal: float) -> float:
    """The value at a standard normal number: a normal distribution cut off at the bounds."""
    from scipy.stats import norm, truncnorm

    low, high = ((bound - unknown.value) / unknown.deviation for bound in unknown.bounds)
    return unknown.value + unknown.deviation * float(truncnorm.ppf(norm.cdf(normal), low, high))


def _changed(
    number: int, rig: Rig, effects: Effects, uncertain: tuple[Unknown, ...], values: Mapping[str, float]
) -> DrawnRig:
    own = {name: value for name, value in values.items() if name in rig}
    acting = {
        effect: {name: values.get(f"{effect}.{name}", value) for name, value in known.items()}
        for effect, known in effects.items()
    }
    away = {u.name: (values[u.name] - u.value) / u.deviation for u in uncertain}
    return DrawnRig(number, rig.replace("drawn", **own), acting, away)
