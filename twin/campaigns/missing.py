"""What a `campaign.toml` lacks beside its keys: parameters of a rig without a preset, gains, and places of gauges."""

from __future__ import annotations

from collections.abc import Iterator

from twin import rigs
from twin.campaigns import schema, units
from twin.errors import InputError, nearest
from twin.parameters import DEFAULTS, PARAMETERS

_INSTEAD_OF_A_GAIN = {
    "V": 'kind = "voltage", resistance, torque_constant and gear_ratio',
    "A": 'kind = "current", torque_constant and gear_ratio',
}
"""Unit of a command -> what [drive] needs of a motor, instead of a gain."""


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
        place = ("position",) if units.is_curvature(channel.unit) else ("position", "half_thickness")
        for key in place if units.is_strain(name) else ():
            if getattr(channel, key) is None:
                yield f"channels.{name}.{key} is missing; a strain gauge needs it, in m"
