"""Controllers by name: the paper's two, variants of them, and those of users' files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from twin.control.laws.base import Controller
from twin.control.laws.friction import FrictionFeedForward
from twin.control.laws.lqi import least_damped_mode, lqi
from twin.control.laws.shaper import ShapedReference, extra_insensitive, zero_vibration
from twin.control.laws.siso import siso
from twin.errors import InputError, nearest
from twin.foreign import shown

Factory = Callable[[Mapping[str, float], float], Controller]
"""Makes a controller for a rig's parameters and a sample period [s]."""


def shaped_lqi(rig: Mapping[str, float], period: float) -> Controller:
    """Returns the LQ regulator with a zero-vibration shaper for the least damped mode of its loop."""
    return ShapedReference(lqi(rig, period), *zero_vibration(*least_damped_mode(rig)), period)


def insensitive_lqi(rig: Mapping[str, float], period: float) -> Controller:
    """Returns the LQ regulator with an extra-insensitive shaper for the same mode."""
    return ShapedReference(lqi(rig, period), *extra_insensitive(*least_damped_mode(rig)), period)


def siso_with_friction(rig: Mapping[str, float], period: float) -> Controller:
    """Returns the paper's compensator with feed-forward of the Coulomb friction level."""
    return FrictionFeedForward(siso(rig, period), rig["coulomb_friction"], period)


# Name on the command line -> design function.
CONTROLLERS: Mapping[str, Factory] = {
    "siso": siso,
    "lqi": lqi,
    "lqi-zv": shaped_lqi,
    "lqi-ei": insensitive_lqi,
    "siso-friction": siso_with_friction,
}


def controller(name: str, rig: Mapping[str, float], period: float) -> Controller:
    """Returns the controller called `name`, or NAME of a user's FILE.py, designed for a rig.

    Args:
      name: a key of `CONTROLLERS`, or FILE.py:NAME.
      rig: parameters of its design model.
      period: sample period [s].

    Raises:
      InputError: there is no such controller, or its file cannot be used.
    """
    if not isinstance(name, str):
        raise InputError(
            f"the controller is {shown(name)}; expected a name or FILE.py:NAME, since every run makes one of its own"
        )
    if name in CONTROLLERS:
        return CONTROLLERS[name](rig, period)
    file, colon, attribute = name.rpartition(":")
    if name.endswith(".py"):
        raise InputError(f"'{name}' says no controller of the file; expected {name}:NAME")
    if not colon or not file.endswith(".py"):
        known = ", ".join(CONTROLLERS)
        raise InputError(
            f"'{name}' is not a controller; expected one of: {known}, or FILE.py:NAME{nearest(name, CONTROLLERS)}"
        )
    from twin.control.laws.user import load

    return load(Path(file), attribute, rig, period)
