"""Rigs drawn at random from the uncertainty of the parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.correlations import Correlations
from twin.errors import InputError
from twin.parameters import Rig, relative_uncertainty

Effects = Mapping[str, Mapping[str, float]]
"""Name of an effect -> parameter -> value, SI."""
INDEPENDENT = Correlations()
"""No correlations."""


@dataclass(frozen=True)
class UncertainParameter:
    """One uncertain parameter.

    Attributes:
      name: of a rig parameter, or effect.parameter.
      value: nominal value, SI.
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
      number: 0 for the nominal rig; drawn ones count from 1.
      rig: parameters.
      effects: effects with their parameters.
      deviations: name of an uncertain parameter -> distance from its nominal value in standard deviations.
    """

    number: int
    rig: Rig = field(repr=False)
    effects: Effects = field(repr=False)
    deviations: Mapping[str, float]


@dataclass(frozen=True)
class NominalRig:
    """Nominal rig with its uncertainty.

    Attributes:
      rig: parameters, with their relative uncertainty.
      effects: effects with their parameters.
      errors: standard errors of the effects' parameters, SI; those without one are exact.
      correlations: of the errors of all parameters.
    """

    rig: Rig
    effects: Effects = field(default_factory=dict)
    errors: Effects = field(default_factory=dict)
    correlations: Correlations = INDEPENDENT


def nominal_rig_of(campaign: Campaign) -> NominalRig:
    """Returns the rig that a campaign declares, its drive included, with assumed uncertainties where it has none."""
    parameters = {
        name: replace(p, uncertainty=relative_uncertainty(p)) for name, p in campaign.rig.parameters.items()
    }
    return NominalRig(Rig(campaign.name, parameters), campaign.effects, campaign.effect_errors)


def uncertain_parameters(
    rig: Rig, effects: Effects, errors: Effects | None = None
) -> tuple[UncertainParameter, ...]:
    """Returns the uncertain parameters of a rig and its effects.

    Args:
      rig: with the relative uncertainty of its parameters.
      effects: effects with their parameters.
      errors: standard errors of the effects' parameters, SI; those without one are exact.

    Raises:
      InputError: an uncertainty is infinite.
    """
    parameters = []
    for p in rig.parameters.values():
        if p.uncertainty:
            parameters.append(
                UncertainParameter(p.name, p.value, p.uncertainty * abs(p.value), p.bounds, p.unit)
            )
    for effect, values in (errors or {}).items():
        parameters += [
            _effect_parameter(effect, name, effects[effect][name], error) for name, error in values.items()
        ]
    infinite = [u.name for u in parameters if not np.isfinite(u.deviation)]
    if infinite:
        raise InputError(
            f"the uncertainty of {infinite[0]} is infinite; expected a finite one to draw rigs from"
        )
    return tuple(u for u in parameters if u.deviation > 0)


def draw_rigs(
    rig: Rig,
    effects: Effects,
    uncertain: tuple[UncertainParameter, ...],
    count: int,
    seed: int,
    correlations: Correlations = INDEPENDENT,
) -> list[DrawnRig]:
    """Returns the nominal rig and `count` rigs drawn from correlated normal distributions truncated at the bounds.

    The k-th rig of a seed does not depend on `count`.
    """
    rigs = [DrawnRig(0, rig, effects, {u.name: 0.0 for u in uncertain})]
    root = correlations.root([u.name for u in uncertain])
    for number in range(1, count + 1):
        normal = root @ np.random.default_rng([seed, number]).standard_normal(len(uncertain))
        values = {u.name: _truncated_normal(u, z) for u, z in zip(uncertain, normal, strict=True)}
        rigs.append(_drawn_rig(number, rig, effects, uncertain, values))
    return rigs


def _effect_parameter(effect: str, name: str, value: float, error: float) -> UncertainParameter:
    from twin.effects import REGISTRY

    parameter = next(p for p in REGISTRY[effect].parameters if p.name == name)
    return UncertainParameter(f"{effect}.{name}", value, error, parameter.possible_range, parameter.unit)


def _truncated_normal(unknown: UncertainParameter, normal: float) -> float:
    """Maps a standard normal number to the parameter's normal distribution, truncated at its bounds."""
    from scipy.stats import norm, truncnorm

    low, high = ((bound - unknown.value) / unknown.deviation for bound in unknown.bounds)
    return unknown.value + unknown.deviation * float(truncnorm.ppf(norm.cdf(normal), low, high))


def _drawn_rig(
    number: int,
    rig: Rig,
    effects: Effects,
    uncertain: tuple[UncertainParameter, ...],
    values: Mapping[str, float],
) -> DrawnRig:
    """The nominal rig with drawn values of its uncertain parameters (by name)."""
    own = {name: value for name, value in values.items() if name in rig}
    acting = {
        effect: {name: values.get(f"{effect}.{name}", value) for name, value in known.items()}
        for effect, known in effects.items()
    }
    away = {u.name: (values[u.name] - u.value) / u.deviation for u in uncertain}
    return DrawnRig(number, rig.replace("drawn", **own), acting, away)
