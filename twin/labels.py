"""Quantities as people read them: degrees, microstrain, digits that are known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from twin.recording import HUB_TORQUE


@dataclass(frozen=True)
class Display:
    """How a channel is shown.

    Attributes:
      label: its name for people.
      unit: the unit shown.
      factor: shown = factor * SI.
    """

    label: str
    unit: str
    factor: float


_DEGREE = 180.0 / math.pi
CHANNELS: Mapping[str, Display] = {
    "torque_command": Display("commanded torque", "N m", 1.0),
    "motor_torque": Display("motor torque", "N m", 1.0),
    "hub_reference": Display("hub reference", "°", _DEGREE),
    "hub_angle": Display("hub angle", "°", _DEGREE),
    "strain_base": Display("base strain", "µε", 1e6),
    "strain_mid": Display("mid strain", "µε", 1e6),
    "tip_deflection": Display("tip deflection", "mm", 1e3),
    "tip_acceleration": Display("tip acceleration", "m/s²", 1.0),
}
"""Every channel of the recording format as people read it."""
_VARIABLES: Mapping[str, Display] = {
    "hub_angle": CHANNELS["hub_angle"],
    "hub_rate": Display("hub rate", "rad/s", 1.0),
    "hub_acceleration": Display("hub acceleration", "rad/s²", 1.0),
    "time": Display("time", "s", 1.0),
    "tip_rate": Display("tip rate", "m/s", 1.0),
    "hub_travel": Display("hub travel since it turned round", "°", _DEGREE),
}


def channel(name: str) -> Display:
    """Returns how a channel is shown; one that the format does not know keeps its name and SI unit."""
    return CHANNELS.get(name, Display(words(name), "SI", 1.0))


def variable(name: str) -> Display:
    """Returns how a variable that an unexplained force may depend on is shown."""
    return _VARIABLES.get(name) or CHANNELS.get(name) or Display(words(name), "", 1.0)


def with_the(name: str) -> str:
    """Returns a channel or variable as a sentence has it."""
    label = variable(name).label
    return label if name == "time" else f"the {label}"


def unmodelled(name: str) -> Display:
    """Returns how that is shown which a model leaves of a channel, or of the balance of the hub."""
    shown = Display("hub torque", "N m", 1.0) if name == HUB_TORQUE else channel(name)
    return replace(shown, label=f"unmodelled {shown.label}")


def words(name: str) -> str:
    """Returns an identifier as words: "cable-torsion" becomes "cable torsion"."""
    return name.replace("-", " ").replace("_", " ")


def unit(si: str) -> str:
    """Returns a unit as it is typeset: "N*m^2" becomes "N m²"; nothing for a plain number."""
    shown = {"1": "", "-": ""}.get(si, si)
    for plain, typeset in (("*", " "), ("^2", "²"), ("^3", "³"), ("^4", "⁴")):
        shown = shown.replace(plain, typeset)
    return shown


def number(value: float | None, digits: int = 3) -> str:
    """Returns a value with so many significant digits and no exponent where it can be read without."""
    if value is None or not math.isfinite(value):
        return "∞" if value == math.inf else "-∞" if value == -math.inf else "–"
    if value == 0.0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -5 <= exponent < 6:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - exponent, 0)}f}"


def with_error(value: float, error: float | None) -> str:
    """Returns "0.0101 ± 0.0003": a digit of the error, or two if it starts below 3, the value to match."""
    if error is None or not math.isfinite(error) or error <= 0.0 or not math.isfinite(value):
        return number(value, 4)
    exponent = math.floor(math.log10(error))
    digits = 1 if error / 10.0**exponent < 3.0 else 0
    if exponent - digits >= -7 and max(abs(value), error) < 1e6:
        decimals = max(digits - exponent, 0)
        return f"{value:.{decimals}f} ± {error:.{decimals}f}"
    power = math.floor(math.log10(max(abs(value), error)))
    decimals, scale = max(power - exponent + digits, 0), 10.0**-power
    return f"({value * scale:.{decimals}f} ± {error * scale:.{decimals}f})e{power}"


def over_noise(error: float, noise: float) -> float:
    """Returns an error in units of the sensor's standard deviation, or NaN where that is not known."""
    known = noise is not None and math.isfinite(noise) and noise > 0
    return error / noise if known and math.isfinite(error) else math.nan


def ratio(value: float) -> str:
    """Returns an error over noise with the digits worth reading."""
    if not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}"


def angle_in_degrees(value: float, si: str) -> str:
    """Returns an angle in degrees beside its radians, or nothing for another quantity."""
    degrees = value * _DEGREE
    return f"{degrees:.{1 if abs(degrees) >= 1 else 2}f}°" if si == "rad" and math.isfinite(degrees) else ""


def probability(value: float) -> str:
    """Returns a probability as a person says it, never a false certainty."""
    if not math.isfinite(value):
        return "–"
    return "> 99.9 %" if value > 0.999 else "< 0.1 %" if value < 0.001 else f"{100 * value:.3g} %"


def join_with_and(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
