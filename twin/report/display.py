"""Quantities as people read them: degrees, microstrain, digits that are known, effects in plain words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from twin.diagnosis import AdoptedEffect, ChannelError, Diagnosis, Prediction
from twin.patch import HUB


@dataclass(frozen=True)
class Shown:
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

CHANNELS: Mapping[str, Shown] = {
    "torque_command": Shown("commanded torque", "N m", 1.0),
    "motor_torque": Shown("motor torque", "N m", 1.0),
    "hub_reference": Shown("hub reference", "°", _DEGREE),
    "hub_angle": Shown("hub angle", "°", _DEGREE),
    "strain_base": Shown("base strain", "µε", 1e6),
    "strain_mid": Shown("mid strain", "µε", 1e6),
    "tip_deflection": Shown("tip deflection", "mm", 1e3),
    "tip_acceleration": Shown("tip acceleration", "m/s²", 1.0),
}
"""Every channel of the recording format as people read it."""

MODELS = ("before", "calibrated", "after")
"""Names of the models in the order in which a diagnosis comes to them."""

MEANINGS: Mapping[str, str] = {
    "viscous-friction": "friction that grows with the speed of the hub",
    "stribeck-friction": "friction that falls smoothly from break-away to Coulomb level",
    "asymmetric-friction": "friction that differs between the two directions",
    "position-dependent-friction": "friction that depends on where the hub stands",
    "cable-torsion": "wires that pull the hub back like a spring",
    "cogging": "a torque of the motor's magnets that repeats with the angle",
    "torque-gain": "a drive that delivers another multiple of the commanded torque",
    "torque-bias": "a constant torque on the hub",
    "actuator-lag": "a drive that follows its command with a lag",
    "actuator-delay": "a drive that follows its command after a dead time",
    "backlash": "play between motor and hub",
    "gravity-tilt": "gravity, because the plane is not level",
    "periodic-disturbance": "a disturbance at one fixed frequency",
    "payload-mass": "another payload than the declared one",
    "stiffness-loss": "a link that is softer than declared all along, or stiffer",
    "softening-stiffness": "a link that gets softer the more it bends",
    "torsional-mode": "a lightly damped extra mode of the link",
    "root-compliance": "a clamp between hub and link that gives",
    "air-drag": "drag on the tip, growing with the square of its speed",
    "air-pad-drag": "drag on the tip, proportional to its speed",
    "hub-sensor-gain": "an angle sensor with another gain than declared",
    "hub-sensor-nonlinearity": "an angle sensor that is not linear",
    "strain-gain": "strain bridges with another gain than declared",
    "strain-drift": "strain bridges that drift in time",
    "sensor-delay": "channels that arrive late",
}
"""The vocabulary in plain words, to follow "The model lacks ..."."""

NOISE_LIKE = 2.0
"""Up to this many noise levels a residual is called indistinguishable from noise (table, headline)."""

_VARIABLES: Mapping[str, Shown] = {
    "hub_angle": CHANNELS["hub_angle"],
    "hub_rate": Shown("hub rate", "rad/s", 1.0),
    "hub_acceleration": Shown("hub acceleration", "rad/s²", 1.0),
    "time": Shown("time", "s", 1.0),
    "tip_rate": Shown("tip rate", "m/s", 1.0),
    "hub_travel": Shown("hub travel since it turned round", "°", _DEGREE),
}


def channel(name: str) -> Shown:
    """Returns how a channel is shown; one that the format does not know keeps its name and SI unit."""
    return CHANNELS.get(name, Shown(words(name), "SI", 1.0))


def variable(name: str) -> Shown:
    """Returns how a variable that an unexplained force may depend on is shown."""
    return _VARIABLES.get(name) or CHANNELS.get(name) or Shown(words(name), "", 1.0)


def named(name: str) -> str:
    """Returns a channel or variable as a sentence has it."""
    label = variable(name).label
    return label if name == "time" else f"the {label}"


def unmodelled(name: str) -> Shown:
    """Returns how that is shown which a model leaves of a channel, or of the balance of the hub."""
    shown = Shown("hub torque", "N m", 1.0) if name == HUB else channel(name)
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


def parameter_rows(effect: AdoptedEffect) -> list[tuple[str, str, str, str]]:
    """Returns (name, value with standard error, unit, degrees or "") of each parameter of an effect."""
    rows = []
    for name, value in effect.parameters.items():
        si = effect.units.get(name, "")
        shown = with_error(value, effect.standard_errors.get(name))
        rows.append((name, shown, unit(si), angle_in_degrees(value, si)))
    return rows


def by_role(diagnosis: Diagnosis, role: str) -> dict[str, Prediction]:
    """Returns the predictions of one role by file name."""
    return {file: p for file, p in diagnosis.predictions.items() if p.role == role}


def judged(diagnosis: Diagnosis) -> dict[str, Prediction]:
    """Returns the recordings that the answer is judged on: the held-out ones, or all if none was held out."""
    return by_role(diagnosis, "holdout") or dict(diagnosis.predictions)


def worst(predictions: Iterable[Prediction], model: str) -> tuple[Prediction, str, float] | None:
    """Returns (recording, channel, error over noise) where `model` is furthest off.

    Args:
      predictions: the recordings.
      model: "before", "calibrated" or "after".
    """
    found = [
        (prediction, name, over_noise(getattr(error, model), error.noise))
        for prediction in predictions
        for name, error in prediction.errors.items()
    ]
    found = [entry for entry in found if math.isfinite(entry[2])]
    return max(found, key=lambda entry: entry[2], default=None)


def remaining(diagnosis: Diagnosis) -> list[tuple[str, str, ChannelError, float]]:
    """Returns (file, channel, error, error over noise) of what the final model still misses, worst first."""
    rows = [
        (file, name, error, over_noise(error.after, error.noise))
        for file, prediction in judged(diagnosis).items()
        for name, error in prediction.errors.items()
    ]
    return sorted((row for row in rows if row[3] > NOISE_LIKE), key=lambda row: -row[3])


def headline(diagnosis: Diagnosis) -> str:
    """Returns the verdict in one plain sentence."""
    names = [words(e.name) for e in diagnosis.effects]
    if diagnosis.verdict == "explained":
        meaning = MEANINGS.get(diagnosis.effects[0].name) if len(names) == 1 else None
        if meaning:
            return f"The model lacks {names[0]}: {meaning}."
        return f"The model lacks {_listed(names)}." if names else "The deviation is explained."
    if diagnosis.verdict == "no-missing-effect":
        return "Nothing is missing: the declared model, calibrated within its uncertainty, explains these recordings."
    if names:
        explain = "explains" if len(names) == 1 else "explain"
        return f"{_listed(names).capitalize()} {explain} part of it; the rest is outside the library."
    return "Something is missing that no effect in the library explains."


def improvement(diagnosis: Diagnosis) -> str:
    """Returns a sentence on the worst error over noise before and after, where anything was simulated."""
    shown = judged(diagnosis)
    before, after = worst(shown.values(), "before"), worst(shown.values(), "after")
    if before is None or after is None:
        return ""
    what = "held-out recordings" if by_role(diagnosis, "holdout") else "fitted recordings (none was held out)"
    return (
        f"On the {what} the worst channel was off by {ratio(before[2])} times its sensor noise "
        f"with the declared model, and is off by {ratio(after[2])} times with the final one."
    )


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
