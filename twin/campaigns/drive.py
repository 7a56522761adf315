"""The drive as a laboratory declares it: from volts or amperes to the torque at the hub.

An ideal DC motor with winding resistance R, torque constant k_t and back-EMF constant k_e, behind a gear of ratio N and
efficiency eta, turns the hub with

    torque = eta N k_t (V - N k_e omega) / R

under a voltage V at hub rate omega, and with eta N k_t I under a current I. So a voltage drive is a gain and a viscous
friction. Both are known effects of the rig, fitted within their uncertainty: the gain of a motor and its gear is never
known as well as a torque.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from twin.campaigns import schema, units
from twin.errors import InputError

DEFAULT_UNCERTAINTY = 0.1
"""Relative uncertainty of the gain of a voltage or current drive, and of its back-EMF constant, where none is declared:
data sheets of motors give their constants to 10 %, and the efficiency of a gear depends on its load."""

_NEEDED = {"torque": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}
COMMAND_UNITS = {"current": "A", "voltage": "V"}
"""Kind of the drive of a motor -> unit of its command."""
MOTOR_KINDS = {unit: kind for kind, unit in COMMAND_UNITS.items()}
"""Unit of a command -> kind of the drive of a motor."""
_OF_A_MOTOR = {"resistance", "torque_constant", "back_emf_constant", "efficiency"}


def check_drive(content: schema.CampaignFile) -> None:
    """Makes sure that the drive has the constants that its kind needs, and the command the unit of the kind.

    Raises:
      InputError: something is missing or contradicts.
    """
    drive = content.drive
    _check_kind(content)
    for key in _NEEDED[drive.kind]:
        if getattr(drive, key) is None:
            raise InputError(f'{schema.FILE}: drive.{key} is missing; kind = "{drive.kind}" needs it')
    command = content.channels.get("torque_command")
    if drive.kind == "torque" or command is None:
        return
    unit = COMMAND_UNITS[drive.kind]
    if not units.convertible(command.unit, unit):
        raise InputError(
            f"{schema.FILE}: channels.torque_command.unit is '{command.unit}'; expected '{unit}', because "
            f'[drive] has kind = "{drive.kind}"'
        )


def _check_kind(content: schema.CampaignFile) -> None:
    """Raises InputError where a `[drive]` without a kind, which is that of a torque, is of a motor."""
    command = content.channels.get("torque_command")
    unit = units.raw_unit(command.unit) if command is not None and command.gain is None else None
    declared = content.drive.model_fields_set
    if "drive" not in content.model_fields_set or "kind" in declared or not (unit or declared & _OF_A_MOTOR):
        return
    sure = f'"{MOTOR_KINDS[unit]}", as the command is in {unit}' if unit else ""
    expected = sure or '"voltage", "current" or "torque"'
    raise InputError(f"{schema.FILE}: drive.kind is missing; expected {expected}")


def torque_per_command(drive: schema.DriveEntry) -> float:
    """Torque at the resting hub per command [N m per unit of the command]."""
    if drive.kind == "torque":
        return 1.0
    per_ampere = drive.efficiency * drive.gear_ratio * (drive.torque_constant or 0.0)
    return per_ampere / (drive.resistance or 1.0) if drive.kind == "voltage" else per_ampere


class RawCommand(NamedTuple):
    """What a command in volts or amperes nominally does.

    Attributes:
      torque: at the resting hub per unit [N m/V], [N m/A].
      unit: "V" or "A".
      is_of_drive: whether it follows from a declared drive, not from a gain.
    """

    torque: float
    unit: str
    is_of_drive: bool


def raw_command(content: schema.CampaignFile) -> RawCommand | None:
    """What a command in volts or amperes does; None of a command in N m."""
    command = content.channels.get("torque_command")
    raw = units.raw_unit(command.unit) if command is not None else None
    if command is None or raw is None:
        return None
    gain = 1.0 if command.gain is None else command.gain
    return RawCommand(abs(gain) * torque_per_command(content.drive), raw, content.drive.kind != "torque")


def known_effects(
    drive: schema.DriveEntry,
) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Effects that the drive has -> parameter -> value, and their standard errors; none of a torque drive."""
    if drive.kind == "torque":
        return {}, {}
    gain = _combined(drive, ("torque_constant", "gear_ratio", "efficiency", "resistance"))
    effects, errors = {"torque-gain": {"gain": 1.0}}, {"torque-gain": {"gain": gain}}
    if drive.kind == "voltage":
        constant = drive.torque_constant if drive.back_emf_constant is None else drive.back_emf_constant
        viscous = torque_per_command(drive) * drive.gear_ratio * (constant or 0.0)
        if viscous > 0:
            relative = math.hypot(gain, _combined(drive, ("back_emf_constant", "gear_ratio")))
            effects["viscous-friction"] = {"viscous": viscous}
            errors["viscous-friction"] = {"viscous": relative * viscous}
    return effects, errors


def _combined(drive: schema.DriveEntry, names: Iterable[str]) -> float:
    """Relative standard deviation of a product of constants; the default where none is declared."""
    declared = [getattr(drive, f"{name}_uncertainty") for name in names]
    if all(value is None for value in declared):
        return DEFAULT_UNCERTAINTY
    return math.hypot(*(value for value in declared if value is not None))
