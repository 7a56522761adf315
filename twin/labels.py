"""Names, units and numbers as people read them: degrees, microstrain, as many digits as are significant."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from twin.recording import HUB_TORQUE


@dataclass(frozen=True)
class Display:
    """How a quantity is displayed.

    Attributes:
      label: its name for people.
      unit: displayed unit.
      factor: displayed value = factor * SI value.
    """

    label: str
    unit: str
    factor: float


_DEGREE = 180.0 / math.pi
CHANNELS: Mapping[str, Display] = {
    "torque_command": Display("commanded torque", "N·m", 1.0),
    "motor_torque": Display("motor torque", "N·m", 1.0),
    "hub_reference": Display("hub reference", "°", _DEGREE),
    "hub_angle": Display("hub angle", "°", _DEGREE),
    "hub_rate": Display("hub rate", "rad/s", 1.0),
    "strain_base": Display("base strain", "µε", 1e6),
    "strain_mid": Display("mid strain", "µε", 1e6),
    "tip_deflection": Display("tip deflection", "mm", 1e3),
    "tip_acceleration": Display("tip acceleration", "m/s²", 1.0),
}
"""Channel of the recording format -> its display."""
VARIABLES: Mapping[str, Display] = {
    "hub_angle": CHANNELS["hub_angle"],
    "hub_rate": CHANNELS["hub_rate"],
    "hub_acceleration": Display("hub acceleration", "rad/s²", 1.0),
    "time": Display("time", "s", 1.0),
    "tip_rate": Display("tip rate", "m/s", 1.0),
    "hub_travel": Display("hub travel since it turned round", "°", _DEGREE),
}
PLACES: Mapping[str, str] = {
    HUB_TORQUE: "a torque on the hub",
    "drive": "a torque of the drive",
    "tip_force": "a force on the tip",
}
"""Place where an unnamed function acts -> what it would be."""
METRICS: Mapping[str, Display] = {
    "hub_final_deg": Display("hub angle at the end", "°", 1.0),
    "hub_min_deg": Display("smallest hub angle", "°", 1.0),
    "hub_max_deg": Display("largest hub angle", "°", 1.0),
    "peak_deflection_mm": Display("largest tip deflection", "mm", 1.0),
    "peak_torque_nm": Display("largest motor torque", "N·m", 1.0),
    "saturated_fraction": Display("time at the torque limit", "%", 100.0),
    "stuck_fraction": Display("time in which the hub sticks", "%", 100.0),
}
"""Metric of a run -> its display; the factor is that of the metric."""


def channel(name: str) -> Display:
    """Returns the display of a channel; one unknown to the format keeps its name and SI unit."""
    return CHANNELS.get(name, Display(words(name), "SI", 1.0))


def amount(name: str, value: float) -> str:
    """Returns a value of a channel [SI] with two digits in its displayed unit: "0.017°", "2.0 µε"."""
    shown = channel(name)
    if not math.isfinite(value):
        return number(value)
    return f"{number(shown.factor * value, 2)}{'' if shown.unit == '°' else ' '}{shown.unit}"


def variable(name: str) -> Display:
    """Returns the display of a variable on which an unexplained force may depend."""
    return VARIABLES.get(name) or CHANNELS.get(name) or Display(words(name), "", 1.0)


def with_the(name: str) -> str:
    """Returns the name of a channel or variable for use in a sentence, with its article: "the hub angle", "time"."""
    label = variable(name).label
    return label if name == "time" else f"the {label}"


def acting(place: str) -> str:
    """Returns what an unnamed function would be, see `twin.diagnosis.state.FunctionOf`: "a force on the tip"."""
    if place in PLACES:
        return PLACES[place]
    return f"an error of {with_the(place)}" if place in CHANNELS else f"a change of the {words(place)}"


def dependence(variables: Sequence[str], place: str | None = None) -> str:
    """Returns what unexplained residuals do: "depends on time", "acts like a force on the tip that depends on time"."""
    on = join_with_and([with_the(name) for name in variables[:3]])
    return f"acts like {acting(place)} that depends on {on}" if place else f"depends on {on}"


def unmodelled(name: str) -> Display:
    """Returns the display of the residual of a channel, or of the hub's torque balance."""
    shown = Display("hub torque", "N·m", 1.0) if name == HUB_TORQUE else channel(name)
    return replace(shown, label=f"unmodelled {shown.label}")


_SPELLING = {
    "stribeck": "Stribeck",
    "coulomb": "Coulomb",
    "air pad": "air-pad",
    "position dependent": "position-dependent",
}
_MISSPELT = re.compile(rf"\b({'|'.join(_SPELLING)})\b")


def words(name: str) -> str:
    """Returns an identifier as words: "cable-torsion" becomes "cable torsion"."""
    plain = name.replace("-", " ").replace("_", " ")
    return _MISSPELT.sub(lambda found: _SPELLING[found.group()], plain)


def sentence(text: str) -> str:
    """Returns a text with a capital at its beginning; the others stay: "Stribeck friction and Coulomb friction"."""
    return text[:1].upper() + text[1:]


def parameter(name: str) -> str:
    """Returns the name of a parameter in words: "viscous-friction.viscous" becomes "viscous friction: viscous"."""
    return words(name).replace(".", ": ")


def unit(si: str) -> str:
    """Returns a typeset unit: "N*m^2" becomes "N·m²"; "" for a dimensionless number."""
    shown = {"1": "", "-": "", "deg": "°"}.get(si, si)
    for plain, typeset in (("*", "·"), ("^2", "²"), ("^3", "³"), ("^4", "⁴")):
        shown = shown.replace(plain, typeset)
    return shown


def number(value: float | None, digits: int = 3) -> str:
    """Returns a value with so many significant digits, with a power of ten only where it is very large or small.

    A whole number keeps three digits at least.
    """
    if value is None or not math.isfinite(value):
        return "∞" if value == math.inf else "−∞" if value == -math.inf else "–"
    if value == 0.0:
        return "0"
    sign, size = "−" if value < 0 else "", abs(value)
    # Of the rounded value: 0.000997 is 0.0010 with two digits.
    exponent = int(f"{size:.{digits - 1}e}".partition("e")[2])
    if not -5 <= exponent < 6:
        mantissa, _, power = f"{size:.{digits - 1}e}".partition("e")
        return f"{sign}{mantissa}{_power_of_ten(int(power))}"
    if exponent >= digits:
        size = float(f"{size:.{max(digits, 3) - 1}e}")
    return f"{sign}{size:.{max(digits - 1 - exponent, 0)}f}"


def typeset(formatted: str) -> str:
    """Returns a formatted number with a minus sign in the place of a hyphen."""
    return formatted.replace("-", "−")


def signed(value: float, decimals: int) -> str:
    """Returns a value with its sign and so many decimals, "+0.69"; what is rounded to zero has none."""
    text = f"{value:+.{decimals}f}"
    return typeset(text if float(text) else text[1:])


def _power_of_ten(exponent: int) -> str:
    return f" × 10{str(exponent).translate(_RAISED)}"


def with_error(value: float, error: float | None, most: int | None = None) -> str:
    """Returns "0.0101 ± 0.0003": one digit of the error, two if the first is 1 or 2, and the value to match.

    Args:
      value, error: in one unit.
      most: significant digits that the value keeps though its error allows more; None for all.
    """
    if error is None or not math.isfinite(error) or error <= 0.0 or not math.isfinite(value):
        return number(value, 4)
    exponent = math.floor(math.log10(error))
    digits = 1 if error / 10.0**exponent < 3.0 else 0
    power = math.floor(math.log10(max(abs(value), error)))
    # Decimal places of value and error, counted from the decimal point.
    value_places = places = digits - exponent
    if most is not None and value_places > most - 1 - power:
        value_places, places = most - 1 - power, max(most - 1 - power, -exponent)
    if exponent - digits >= -7 and power < 6:
        return typeset(f"{value:.{max(value_places, 0)}f} ± {error:.{max(places, 0)}f}")
    scale = 10.0**-power
    value_places, places = max(value_places + power, 0), max(places + power, 0)
    return typeset(f"({value * scale:.{value_places}f} ± {error * scale:.{places}f}){_power_of_ten(power)}")


PAGE_DIGITS = 4
"""Most significant digits of a value on a page; files have all of them."""


def over_noise(error: float, noise: float) -> float:
    """Returns an error divided by the standard deviation of the sensor's noise; NaN where that is unknown."""
    known = noise is not None and math.isfinite(noise) and noise > 0
    return error / noise if known and math.isfinite(error) else math.nan


def ratio(value: float) -> str:
    """Returns a ratio of error to noise, with one decimal below 100."""
    if not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}"


def duration(seconds: float) -> str:
    """Returns a time in the unit that suits it: "40 s", "6 min", "2.5 h"."""
    if seconds < 90:
        return f"{number(seconds, 1 if seconds < 10 else 2)} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def angle_in_degrees(value: float, si: str) -> str:
    """Returns an angle [rad] in degrees, or "" where the unit `si` is not "rad"."""
    degrees = value * _DEGREE
    return (
        typeset(f"{degrees:.{1 if abs(degrees) >= 1 else 2}f}°")
        if si == "rad" and math.isfinite(degrees)
        else ""
    )


def probability(value: float) -> str:
    """Returns a probability in percent, limited to "< 0.1 %" and "> 99.9 %"."""
    if not math.isfinite(value):
        return "–"
    return "> 99.9 %" if value > 0.999 else "< 0.1 %" if value < 0.001 else f"{100 * value:.3g} %"


_ASCII = {
    "±": "+-", "µ": "u", "μ": "u", "ε": "e", "σ": "sigma", "θ": "theta", "°": " deg",
    "–": "-", "—": "-", "−": "-", "∞": "inf", "≤": "<=", "≥": ">=", "×": "x", "·": " ", "…": "...", "→": "->",
}  # fmt: skip
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_EXPONENT = re.compile("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+")


def printable(text: str, plain: bool = False) -> str:
    """Returns a text without control characters, which could command a terminal; in ASCII where `plain`."""
    shown = "".join(c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in text)
    if not plain:
        return shown
    shown = _EXPONENT.sub(lambda found: f"^{found.group().translate(_LOWERED)}", shown)
    shown = "".join(_ASCII.get(c, c) for c in shown)
    # Letters lose their accents.
    bare = "".join(c for c in unicodedata.normalize("NFKD", shown) if not unicodedata.combining(c))
    return bare.encode("ascii", "replace").decode()


def join_with_and(items: list[str]) -> str:
    """Returns "a, b and c"."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
