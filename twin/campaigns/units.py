"""Units of the recording format and their conversion to SI."""

from __future__ import annotations

from functools import cache

from twin.errors import InputError, nearest
from twin.recording import CHANNEL_UNITS

UNITS = ("rad", "deg", "N*m", "m", "mm", "1", "microstrain", "V", "A", "s", "1/m", "m/s^2", "rad/s")
"""Every unit that a campaign may name."""

RAW_UNITS = ("V", "A")
"""Units of a raw sensor signal: the channel's `gain` turns them into the SI unit of the channel."""

DERIVED_UNITS = {"motor_angle": "rad", "tip_angle": "rad", "hub_rate": "rad/s"}
"""Channels that are turned into those of a recording when a campaign is read -> SI unit."""

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
"""Units of the time column -> seconds."""

TIME = "time"
"""Name of the time column, which is declared like a channel."""

# Definitions of a separate pint registry: the default one takes 0.2 s to build, and takes angles as dimensionless, so
# that it would convert degrees to strain. Here an angle is a dimension, and a strain a plain number.
_DEFINITIONS = (
    "micro- = 1e-6",
    "milli- = 1e-3 = m-",
    "radian = [angle] = rad",
    "degree = 0.017453292519943295 * radian = deg",
    "meter = [length] = m",
    "second = [time] = s",
    "newton = [force] = N",
    "volt = [potential] = V",
    "ampere = [current] = A",
    "strain = []",
)


@cache
def _registry():
    import pint  # takes 0.2 s: only where a unit is not SI

    registry: pint.UnitRegistry = pint.UnitRegistry(None)
    for definition in _DEFINITIONS:
        registry.define(definition)
    return registry


@cache
def factor(unit: str, target: str) -> float:
    """Returns the number of `target` units in one `unit`.

    Raises:
      InputError: the two measure different quantities, or one of them is not a unit of the format.
    """
    if unit == target:
        return 1.0
    for name in (unit, target):
        if name not in UNITS:
            raise InputError(f"'{name}' is not a unit; expected one of: {', '.join(UNITS)}")
    import pint

    try:
        return float(_registry().Quantity(1.0, unit).to(target).magnitude)
    except pint.DimensionalityError:
        raise InputError(f"'{unit}' cannot be converted to '{target}'") from None


@cache
def allowed(channel: str) -> tuple[str, ...]:
    """Returns the units in which a channel may be recorded, its SI unit first.

    A strain gauge may be calibrated in curvature w'', "1/m": strain = half_thickness * w''.
    """
    if channel == TIME:
        return tuple(TIMES)
    si = _si_unit(channel)
    same = tuple(unit for unit in UNITS if unit != si and _convertible(unit, si))
    curvature = ("1/m",) if is_strain(channel) else ()
    return (si, *same, *curvature, *RAW_UNITS)


def _si_unit(channel: str) -> str:
    return {**CHANNEL_UNITS, **DERIVED_UNITS}[channel]


def is_strain(channel: str) -> bool:
    """Whether the channel is a strain gauge, which has a position and a half thickness."""
    return channel.startswith("strain_")


def scale(channel: str, unit: str, half_thickness: float = 0.0) -> float:
    """Returns the factor from `unit` to the SI unit of the channel.

    Volts and amperes have the factor 1: the gain of the channel is declared in SI per volt or ampere.

    Args:
      channel: name of the channel.
      unit: unit of the recorded values.
      half_thickness: distance of a strain gauge from the neutral axis [m].

    Raises:
      InputError: the channel cannot be recorded in this unit.
    """
    if channel == TIME and unit in TIMES:
        return TIMES[unit]
    if channel != TIME and unit == _si_unit(channel):
        return 1.0
    if unit not in allowed(channel):
        raise InputError(_refusal(channel, unit))
    if unit in RAW_UNITS:
        return 1.0
    return half_thickness if unit == "1/m" else factor(unit, _si_unit(channel))


def _convertible(unit: str, si: str) -> bool:
    try:
        factor(unit, si)
    except InputError:
        return False
    return True


def _refusal(channel: str, unit: str) -> str:
    expected = allowed(channel)
    what = f"does not measure {channel}" if unit in UNITS else "is not a unit of the recording format"
    advice = "" if unit in UNITS else nearest(_spelling(unit), expected)
    return f"'{unit}' {what}; expected one of: {', '.join(expected)}{advice}"


# Common spellings, lower case -> the unit that a message suggests.
_SPELLINGS = {
    "radian": "rad",
    "radians": "rad",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "nm": "N*m",
    "n.m": "N*m",
    "n m": "N*m",
    "n-m": "N*m",
    "n·m": "N*m",
    "newton*meter": "N*m",
    "nmm": "N*m",
    "n*mm": "N*m",
    "mn*m": "N*m",
    "mnm": "N*m",
    "meter": "m",
    "metre": "m",
    "millimeter": "mm",
    "millimetre": "mm",
    "cm": "mm",
    "": "1",
    "-": "1",
    "strain": "1",
    "m/m": "1",
    "ustrain": "microstrain",
    "µstrain": "microstrain",
    "µε": "microstrain",
    "ue": "microstrain",
    "um/m": "microstrain",
    "volt": "V",
    "volts": "V",
    "mv": "V",
    "ampere": "A",
    "amp": "A",
    "ma": "A",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
    "m/s/s": "m/s^2",
    "g": "m/s^2",
}


def _spelling(unit: str) -> str:
    folded = unit.strip().lower().replace("μ", "µ")
    lower = {known.lower(): known for known in UNITS}
    return _SPELLINGS.get(folded, lower.get(folded, unit))
