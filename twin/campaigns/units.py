"""Units of the recording format and their conversion to SI."""

from __future__ import annotations

import math
import re
from functools import cache

from twin.errors import InputError, nearest, shown
from twin.recording import CHANNEL_UNITS

# Unit of the format -> the SI unit of its quantity, and its size in that. An angle is not a plain number.
_USUAL = {
    "rad": ("rad", 1.0),
    "deg": ("rad", 0.017453292519943295),
    "N*m": ("N*m", 1.0),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "1": ("1", 1.0),
    "microstrain": ("1", 1e-6),
    "V": ("V", 1.0),
    "A": ("A", 1.0),
    "s": ("s", 1.0),
    "1/m": ("1/m", 1.0),
    "m/s^2": ("m/s^2", 1.0),
    "rad/s": ("rad/s", 1.0),
}

UNITS = tuple(_USUAL)
"""Units that messages propose; every other unit that pint knows will do as well."""

RAW_UNITS = ("V", "A")
"""Units of a raw sensor signal: the channel's `gain` turns them into the SI unit of the channel."""
_BRIDGE = "V/V"
"""Unit of the raw signal of a bridge over its supply."""

DERIVED_UNITS = {"motor_angle": "rad", "tip_angle": "rad"}
"""Channels that are turned into those of a recording when a campaign is read -> SI unit."""

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
"""Units of the time column -> seconds."""

TIME = "time"
"""Name of the time column, which is declared like a channel."""

# What is asked of pint: a product of names with small powers. Its parser would take years to compute "9**9**9".
_NAME = r"(?:[^\W\d]\w{0,40}|[°%])(?:\s*(?:\^|\*\*)\s*-?[1-4])?"
_PRODUCT = re.compile(rf"(?:1\s*/\s*)?{_NAME}(?:\s*[*/ ]\s*{_NAME}){{0,8}}")
_SIGNS = {"·": "*", "⋅": "*", "²": "^2", "³": "^3", "μ": "µ"}


@cache
def _registry():
    import pint  # with its registry, 0.4 s: only for a unit that is not among the usual ones

    registry: pint.UnitRegistry = pint.UnitRegistry()
    registry.define("strain = 1 = ε")
    return registry


@cache
def _in_base_units(unit: str) -> tuple[float, str] | None:
    """Returns size and name of a unit in pint's base units, where an angle is one; None if it is no unit."""
    spelled = unit.strip()
    for sign, plain in _SIGNS.items():
        spelled = spelled.replace(sign, plain)
    if unit == "1":
        return 1.0, "dimensionless"
    if not _PRODUCT.fullmatch(spelled):
        return None
    registry = _registry()
    try:
        parsed = registry.parse_units(spelled)
        size, base = registry.get_root_units(parsed)
        once, twice = (float(registry.convert(x, parsed, base)) for x in (1.0, 2.0))
    except Exception:  # pint raises errors of many kinds for what it cannot parse
        return None
    # Units with an offset or a logarithm, degC or dB, are no factors.
    return (float(size), str(base)) if math.isclose(twice, 2 * once) else None


@cache
def factor(unit: str, target: str) -> float:
    """Returns the number of `target` units in one `unit`.

    Raises:
      InputError: the two measure different quantities, or one of them is not a unit.
    """
    if unit == target:
        return 1.0
    (size, quantity), (other, wanted) = _sized(unit, target), _sized(target, unit)
    if quantity != wanted:
        raise InputError(f"'{unit}' cannot be converted to '{target}'")
    return size / other


def _sized(unit: str, beside: str) -> tuple[float, str]:
    """Returns size and quantity of a unit, by the usual ones if another unit is one of them, too."""
    if unit in _USUAL and beside in _USUAL:
        quantity, size = _USUAL[unit]
        return size, quantity
    known = _in_base_units(unit)
    if known is None:
        raise InputError(f"'{shown(unit)}' is not a unit; expected one of: {', '.join(UNITS)}")
    return known


def is_unit(unit: str) -> bool:
    """Whether a text is a unit: one of the format, or one that pint knows."""
    return unit in _USUAL or _in_base_units(unit) is not None


def convertible(unit: str, target: str) -> bool:
    """Whether both measure the same quantity."""
    try:
        factor(unit, target)
    except InputError:
        return False
    return True


def raw_unit(unit: str) -> str | None:
    """Returns "V", "A" or, of a bridge, "V/V" for a unit of a raw signal, such as mV or mV/V; None for any other."""
    if unit in _USUAL:
        return unit if unit in RAW_UNITS else None
    if unit.endswith("/V") and convertible(unit, _BRIDGE):
        return _BRIDGE
    return next((raw for raw in RAW_UNITS if convertible(unit, raw)), None)


@cache
def allowed(channel: str) -> tuple[str, ...]:
    """Returns the units in which a channel may be recorded, its SI unit first.

    A strain gauge may be calibrated in curvature w'', "1/m": strain = half_thickness * w''.
    """
    if channel == TIME:
        return tuple(TIMES)
    si = _si_unit(channel)
    same = tuple(unit for unit in UNITS if unit != si and convertible(unit, si))
    curvature = ("1/m",) if is_strain(channel) else ()
    return (si, *same, *curvature, *RAW_UNITS)


def _si_unit(channel: str) -> str:
    return {**CHANNEL_UNITS, **DERIVED_UNITS}[channel]


def is_strain(channel: str) -> bool:
    """Whether the channel is a strain gauge, which has a position and a half thickness."""
    return channel.startswith("strain_")


def is_curvature(unit: str) -> bool:
    """Whether a unit is that of a curvature, such as 1/m."""
    return convertible(unit, "1/m")


def gauge_keys(channel: str, unit: str) -> tuple[str, ...]:
    """Keys of a strain gauge that a channel needs; a curvature is that of the neutral axis; none of other channels."""
    if not is_strain(channel):
        return ()
    return ("position",) if is_curvature(unit) else ("position", "half_thickness")


def scale(channel: str, unit: str, half_thickness: float = 0.0) -> float:
    """Returns the factor from `unit` to the SI unit of the channel.

    Volts and amperes have the factor 1, millivolts 0.001: the gain of the channel is declared in SI per volt or ampere.

    Args:
      channel: name of the channel.
      unit: unit of the recorded values.
      half_thickness: distance of a strain gauge from the neutral axis [m].

    Raises:
      InputError: the channel cannot be recorded in this unit.
    """
    if channel == TIME and unit in TIMES:
        return TIMES[unit]
    si = "s" if channel == TIME else _si_unit(channel)
    if unit == si:
        return 1.0
    if channel != TIME and (raw := raw_unit(unit)):
        return factor(unit, raw)
    if is_strain(channel) and is_curvature(unit):
        return half_thickness * factor(unit, "1/m")
    if not convertible(unit, si):
        raise InputError(_refusal(channel, unit))
    return factor(unit, si)


def _refusal(channel: str, unit: str) -> str:
    expected, right = allowed(channel), spelling(unit)
    meant = right != unit and (right in expected or convertible(right, expected[0]))
    known = is_unit(unit) and not meant
    what = f"does not measure {channel}" if known else "is not a unit of the recording format"
    advice = "" if known else f"; did you mean '{right}'?" if meant else nearest(right, expected)
    return f"'{shown(unit)}' {what}; expected one of: {', '.join(expected)}{advice}"


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
    "nmm": "N*mm",
    "mnm": "mN*m",
    "meter": "m",
    "metre": "m",
    "millimeter": "mm",
    "millimetre": "mm",
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
    "ampere": "A",
    "amp": "A",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
    "m/s/s": "m/s^2",
    "g": "g_0",
}


def spelling(unit: str) -> str:
    """Returns the unit of the format that a text, such as "Nm" or "radians", means; the text itself if none."""
    folded = unit.strip().lower().replace("μ", "µ")
    lower = {known.lower(): known for known in UNITS}
    return _SPELLINGS.get(folded, lower.get(folded, unit))
