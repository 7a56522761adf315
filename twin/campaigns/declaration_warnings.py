"""Sentences on declarations of a `campaign.toml` that can be used, and are probably not what was meant."""

from __future__ import annotations

import math
from collections.abc import Iterator

from twin.campaigns import schema
from twin.campaigns.drive import COMMAND_UNITS
from twin.recording import LONGEST_DELAY

_NOT_COMPARED = {
    "hub_reference": "no simulation is compared with it",
    "tip_angle": "the deflection is its difference from the hub angle",
}
"""Channel -> why its gain and delay are not fitted."""


def declaration_warnings(content: schema.CampaignFile) -> tuple[str, ...]:
    """Returns a sentence for each."""
    return (
        *_zero_noise_warnings(content),
        *_uncertainty_warnings(content),
        *_channel_uncertainty_warnings(content),
        *_command_gain_warnings(content),
        *_payload_warnings(content),
    )


def _zero_noise_warnings(content: schema.CampaignFile) -> Iterator[str]:
    for name, channel in content.channels.items():
        if channel.noise == 0.0:
            yield f"{schema.FILE}: channels.{name}.noise is 0, which no sensor has; taken as not declared"


def _command_gain_warnings(content: schema.CampaignFile) -> Iterator[str]:
    command = content.channels.get("torque_command")
    if command is None or command.gain is None or abs(command.gain) == 1.0 or content.drive.kind == "torque":
        return
    unit = COMMAND_UNITS[content.drive.kind]
    yield (
        f"{schema.FILE}: channels.torque_command.gain is {command.gain:g}, so that 1 {command.unit} of the recording "
        f"counts as {command.gain:g} {unit} at the motor; the torque per {unit} follows from [drive]"
    )


def _payload_warnings(content: schema.CampaignFile) -> Iterator[str]:
    """About the hub, the inertia of a payload is at least its mass times the length of the link squared."""
    given = content.parameters
    inertia, mass, length = (given.get(name, 0.0) for name in ("tip_inertia", "tip_mass", "length"))
    if mass > 0 and inertia >= mass * length**2 > 0:
        yield (
            f"{schema.FILE}: parameters.tip_inertia is {inertia:g} kg*m^2, that of {mass:g} kg at a distance of "
            f"{math.sqrt(inertia / mass):.2g} m; expected the inertia about the tip, not about the hub"
        )


def _uncertainty_warnings(content: schema.CampaignFile) -> Iterator[str]:
    for name, relative in content.uncertainty.items():
        if relative > 1.0:
            yield (
                f"{schema.FILE}: uncertainty.{name} is {relative:g}, which is {100 * relative:g} % of its value, so "
                f"that it is hardly known; for {relative:g} % write {relative / 100:g}"
            )


def _channel_uncertainty_warnings(content: schema.CampaignFile) -> Iterator[str]:
    for name, channel in content.channels.items():
        where, gain, delay = (
            f"{schema.FILE}: channels.{name}",
            channel.gain_uncertainty,
            channel.delay_uncertainty,
        )
        reason = _NOT_COMPARED.get(name)
        if name == "torque_command" and content.drive.kind != "torque":
            reason, delay = "that of [drive] is", None
        for key, value in (("gain_uncertainty", gain), ("delay_uncertainty", delay)):
            if reason and value:
                yield f"{where}.{key} is not used: {reason}"
        if gain and gain > 1.0:
            yield f"{where}.gain_uncertainty is {gain:g}, which is {100 * gain:g} % of the gain; it is relative"
        if delay and delay > LONGEST_DELAY:
            yield f"{where}.delay_uncertainty is {delay:g} s; delays of more than {LONGEST_DELAY:g} s are not tried"
