"""Linear law of the drive under effects, identified from test commands: gain, bias, delay and lag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects import REGISTRY, Drive

_COMMANDS = (0.0, 1.0, -1.0, 0.01, -0.01, 0.3)  # N m, test commands: both signs, small and large
_ROUNDING = 1e-9
"""Departure from a straight line, relative to the largest torque [1], up to which a drive law is linear."""


@dataclass(frozen=True)
class DriveLaw:
    """delivered(t) = gain * commanded(t - delay) + bias, followed by a first-order lag.

    Attributes:
      gain: [1].
      bias: [N m].
      delay, lag: [s].
      linear: whether the drive follows this law; where it does not, `gain` is the secant from 0 to 1 N m.
    """

    gain: float
    bias: float
    delay: float
    lag: float
    linear: bool


def drive_law(effects: Mapping[str, Mapping[str, float]]) -> DriveLaw:
    """Returns the drive law under effects, from commands held from time 0 on."""
    given = [apply_drive_effects(effects, Drive(np.zeros(1), np.array([command]))) for command in _COMMANDS]
    torques = np.array([float(drive.torque[0]) for drive in given])
    bias, gain = torques[0], torques[1] - torques[0]
    departure = np.abs(torques - bias - gain * np.array(_COMMANDS)).max()
    linear = bool(departure <= _ROUNDING * np.abs(torques).max())
    return DriveLaw(float(gain), float(bias), float(given[1].time[0]), given[1].lag, linear)


def apply_drive_effects(effects: Mapping[str, Mapping[str, float]], drive: Drive) -> Drive:
    """Returns a drive with the effects applied to its torques, in their order."""
    for name, p in effects.items():
        drive = REGISTRY[name].drive(drive, p)
    return drive


def nonlinear_drives(effects: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Returns the names of the effects whose drive law is not linear."""
    return tuple(name for name, p in effects.items() if not drive_law({name: p}).linear)
