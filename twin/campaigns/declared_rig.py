"""A campaign with the rig of a parameter file in the place of the one that it declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from twin.campaigns import check_channels, check_rig, schema
from twin.campaigns.campaign import Campaign, check_deflection
from twin.errors import InputError
from twin.parameters import Rig
from twin.rigs.check import check_gauges, check_parameters

Effects = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""


def with_rig(campaign: Campaign, rig: Rig, effects: Effects, errors: Effects | None = None) -> Campaign:
    """Returns the campaign with another declared rig, checked as if `campaign.toml` declared it.

    Args:
      campaign: the campaign.
      rig: its parameters.
      effects: known to act on it.
      errors: standard errors of their parameters; without one, the value is only a rough one.

    Raises:
      InputError: the recordings cannot be of this rig.
    """
    try:
        _check(campaign, rig)
    except InputError as error:
        raise InputError(f"the rig '{rig.name}' cannot be that of {campaign.name}: {error}") from None
    known, known_errors = {**campaign.effects, **effects}, {**campaign.effect_errors, **(errors or {})}
    return replace(campaign, rig=rig, effects=known, effect_errors=known_errors)


def _check(campaign: Campaign, rig: Rig) -> None:
    recordings = (*campaign.fit, *campaign.holdout())
    check_parameters(rig)
    check_gauges(rig, campaign.sensors.values())
    for recording in recordings:
        check_deflection(f"{schema.FILE}: {recording.name}", recording.initial_tip_deflection, rig)
    check_channels.check_signs_and_units(recordings, campaign.sensors, rig)
    check_rig.check_torque(recordings, campaign.sensors, rig)
