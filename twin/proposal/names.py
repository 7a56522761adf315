"""What the name of a column says: its channel, and its unit."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from twin.campaigns import units
from twin.campaigns.units import TIME
from twin.files.layout import unbracketed
from twin.recording import CHANNEL_UNITS

SURE, LIKELY, POSSIBLE = 0.9, 0.7, 0.5
"""How well a name fits a channel: it says so; it is usual for it; it may mean it."""
_UNKNOWN_WORD = 0.05
"""Less for each word that says nothing of the channel: "stage2_current" fits less than "current"."""

_REFERENCE = ["reference", "ref", "setpoint", "goal", "desired", "target", "sollwert", "soll"]
_COMMAND = ["command", "cmd", "commanded", "demand", "demanded", "tau"]
_DRIVE = ["torque", "moment", "voltage", "volt", "volts", "current", "amps", "u", "input"]
_MEASURED = ["measured", "actual", "delivered", "sensed"]
_RATE = ["speed", "rate", "velocity", "vel", "omega", "tacho"]
_LINK = [
    "strain",
    "gauge",
    "gage",
    "bridge",
    "tip",
    "deflection",
    "link",
    "flex",
    "accel",
    "acc",
    "acceleration",
]
_ANGLE = ["angle", "theta", "position", "pos", "encoder", "pot", "potentiometer", "phi"]
_OTHER = [
    "temperature",
    "temp",
    "enable",
    "enabled",
    "load",
    "supply",
    "battery",
    "status",
    "state",
    "mode",
    "counter",
]
_OTHER += ["index", "flag", "fault", "error", "humidity", "pressure"]


@dataclass(frozen=True)
class _Rule:
    """Words of a name that mean a channel: one of each group of `words`, and none of `without`."""

    channel: str
    fit: float
    words: tuple[list[str], ...]
    without: list[str]


_RULES = (
    _Rule(TIME, SURE, (["time", "t", "timestamp", "stamp", "zeit", "secs"],), _COMMAND),
    _Rule("hub_reference", SURE, (_REFERENCE,), [*_DRIVE, *_LINK, "motor"]),
    _Rule("torque_command", SURE, (_COMMAND,), [*_ANGLE, *_LINK, *_RATE, *_REFERENCE, *_MEASURED]),
    _Rule("torque_command", LIKELY, (["motor", "drive"], _DRIVE), [*_MEASURED, *_ANGLE, *_LINK]),
    _Rule("torque_command", POSSIBLE, (_DRIVE,), [*_MEASURED, *_ANGLE, *_LINK, *_REFERENCE]),
    _Rule("motor_torque", LIKELY, (_MEASURED, _DRIVE), [*_ANGLE, *_LINK]),
    _Rule("motor_torque", POSSIBLE, (["current", "torque"],), [*_ANGLE, *_LINK, *_COMMAND, *_REFERENCE]),
    _Rule("motor_angle", LIKELY, (["motor"], _ANGLE), [*_REFERENCE, *_LINK, *_COMMAND]),
    _Rule("hub_angle", SURE, (["hub", "shaft", "joint", "servo"], _ANGLE), [*_REFERENCE, *_LINK, *_COMMAND]),
    _Rule("hub_angle", LIKELY, (_ANGLE,), [*_REFERENCE, *_LINK, *_COMMAND, "motor"]),
    _Rule("hub_rate", LIKELY, (_RATE,), [*_REFERENCE, *_LINK, *_COMMAND]),
    _Rule(
        "strain_mid",
        SURE,
        (["strain", "gauge", "gage", "bridge"], ["mid", "middle", "centre", "center", "2"]),
        [],
    ),
    _Rule("strain_base", SURE, (["strain", "gauge", "gage", "bridge"],), []),
    _Rule("tip_angle", SURE, (["tip"], ["angle"]), _REFERENCE),
    _Rule("tip_acceleration", LIKELY, (["acc", "accel", "acceleration", "accelerometer"],), ["hub", "motor"]),
    _Rule("tip_deflection", LIKELY, (["deflection", "tip"],), ["angle", *_REFERENCE]),
)

# Words that are units, where a name ends in one.
_UNIT_WORDS = {
    "deg": "deg", "degrees": "deg", "rad": "rad", "mrad": "mrad", "v": "V", "volts": "V", "volt": "V", "voltage": "V",
    "mv": "mV", "a": "A", "amps": "A", "ma": "mA", "current": "A", "nm": "N*m", "mnm": "mN*m", "s": "s", "sec": "s",
    "ms": "ms", "us": "us", "mm": "mm", "cm": "cm", "m": "m", "microstrain": "microstrain", "ustrain": "microstrain",
    "ue": "microstrain", "rpm": "rpm", "rads": "rad/s",
}  # fmt: skip
_BRACKETS = re.compile(r"(\[[^\]]*\]|\([^)]*\))\s*$")


def words(name: str) -> list[str]:
    """Returns the words of a name, lower case: of snake case, camel case and paths, the unit in brackets left out."""
    plain = _BRACKETS.sub("", name)
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", plain)
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", split)]


def fits(name: str) -> dict[str, float]:
    """Returns the channels that a name may mean, with how well it fits each."""
    found: dict[str, float] = {}
    for channel, fit in _candidates(name):
        found[channel] = max(fit, found.get(channel, 0.0))
    return found


def _candidates(name: str) -> Iterator[tuple[str, float]]:
    said = words(name)
    for channel in (TIME, *CHANNEL_UNITS, *units.DERIVED_UNITS):
        if "_".join(said[-len(channel.split("_")) :]) == channel:
            yield channel, 1.0
    if says_something_else(name):
        return
    for rule in _RULES:
        if all(set(group) & set(said) for group in rule.words) and not set(rule.without) & set(said):
            meant = {word for group in rule.words for word in group} | set(_UNIT_WORDS)
            yield rule.channel, rule.fit - _UNKNOWN_WORD * sum(word not in meant for word in said)


def says_something_else(name: str) -> bool:
    """Whether a name means what is no channel: a temperature, a counter, another stage of the machine."""
    said = set(words(name))
    return bool(said & set(_OTHER)) or {"stage", "2"} <= said


def unit_of_drive(name: str) -> str:
    """Returns the unit of a command or a measured torque by the quantity in its name; "" if it has none."""
    said = set(words(name))
    quantities = (("V", "voltage volts volt"), ("A", "current amps"), ("N*m", "torque moment tau"))
    return next((unit for unit, quantity in quantities if said & set(quantity.split())), "")


def unit_of(name: str, told: str = "") -> str:
    """Returns the unit of a column: as the file tells it, in brackets behind its name, or its last word; "" if none."""
    brackets = _BRACKETS.search(name)
    for text in (told, unbracketed(brackets[1]) if brackets else ""):
        unit = units.spelling(text) if text else ""
        if unit and units.is_unit(unit):
            return unit
    said = words(name)
    return _UNIT_WORDS.get(said[-1], "") if len(said) > 1 else ""
