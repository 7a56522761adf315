"""What a `campaign.toml` lacks beside its keys: parameters of a rig without a preset, gains, and places of gauges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from twin import rigs
from twin.campaigns import schema, units
from twin.errors import InputError, nearest
from twin.parameters import DEFAULTS, PARAMETERS
from twin.recording import CHANNEL_UNITS

_INSTEAD_OF_A_GAIN = {
    "V": 'kind = "voltage", resistance, torque_constant and gear_ratio',
    "A": 'kind = "current", torque_constant and gear_ratio',
}
"""Unit of a command -> what [drive] needs of a motor, instead of a gain."""


def parse(content: Mapping[str, Any]) -> schema.CampaignFile:
    """Returns the content of a `campaign.toml`, checked.

    Raises:
      InputError: it is not in the format; one line per error. Behind missing units stands what else is missing.
    """
    try:
        return schema.parse(content)
    except InputError as error:
        raise InputError("\n".join((str(error), *_beside_units(content)))) from None


def _beside_units(content: Mapping[str, Any]) -> Iterator[str]:
    """What is missing beside the units of channels; nothing where the content has other errors."""
    channels = content.get("channels")
    if not isinstance(channels, Mapping):
        return
    filled = {
        name: {"unit": units.allowed(name)[0], **channel} if _is_known(name, channel) else channel
        for name, channel in channels.items()
    }
    try:
        parsed = schema.parse({**content, "channels": filled})
    except InputError:
        return
    yield from (f"{schema.FILE}: {line}" for line in (*_parameters(parsed), *_channels(parsed)))


def _is_known(name: str, channel: object) -> bool:
    return isinstance(channel, Mapping) and name in (units.TIME, *CHANNEL_UNITS, *units.DERIVED_UNITS)


def check_complete(content: schema.CampaignFile) -> None:
    """Makes sure that nothing is missing.

    Raises:
      InputError: something is; one line for each.
    """
    missing = [*_parameters(content), *_channels(content)]
    if missing:
        raise InputError("\n".join(f"{schema.FILE}: {line}" for line in missing))


def _parameters(content: schema.CampaignFile) -> Iterator[str]:
    required = [name for name in PARAMETERS if name not in DEFAULTS]
    lacking = [name for name in required if name not in content.parameters]
    if content.rig not in rigs.PRESETS and lacking:
        yield (
            f"rig '{content.rig}' is not a preset ({', '.join(rigs.PRESETS)}), so [parameters] "
            f"must give {', '.join(required)}; missing: {', '.join(lacking)}{nearest(content.rig, rigs.PRESETS)}"
        )


def _channels(content: schema.CampaignFile) -> Iterator[str]:
    if "torque_command" not in content.channels:
        yield "channels.torque_command is missing; expected the torque that drives the rig"
    for name, channel in content.channels.items():
        raw = units.raw_unit(channel.unit)
        is_raw_command = name == "torque_command" and content.drive.kind != "torque"
        if raw and name != units.TIME and channel.gain is None and not is_raw_command:
            si = units.allowed(name)[0]
            motor = (
                f"; or a table [drive] with {_INSTEAD_OF_A_GAIN[raw]} of a DC motor"
                if name == "torque_command"
                else ""
            )
            yield (
                f"channels.{name}.gain is missing; unit '{channel.unit}' needs it: {name} [{si}] = gain * "
                f"(raw - offset), the gain in {si} per {raw}{motor}"
            )
        for key in units.gauge_keys(name, channel.unit):
            if getattr(channel, key) is None:
                yield f"channels.{name}.{key} is missing; a strain gauge needs it, in m"
