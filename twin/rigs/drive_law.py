"""What effects make of a command, found by giving some: delivered(t) = gain * commanded(t - delay) + bias, lagging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.effects import REGISTRY, Drive

_COMMANDS = (0.0, 1.0, -1.0, 0.01, -0.01, 0.3)  # N m
_ROUNDING = 1e-9  # part of the largest torque by which a linear law may be off a line


@dataclass(frozen=True)
class DriveLaw:
    """delivered(t) = gain * commanded(t - delay) + bias, behind a first-order lag.

    Attributes:
      gain: [1].
      bias: [N m].
      delay, lag: [s].
      linear: whether the drive is so; where it is not, `gain` is that from rest to 1 N m.
    """

    gain: float
    bias: float
    delay: float
    lag: float
    linear: bool


def drive_law(effects: Mapping[str, Mapping[str, float]]) -> DriveLaw:
    """The drive under effects, each command held from time 0 on."""
    given = [apply_drive_effects(effects, Drive(np.zeros(1), np.array([command]))) for command in _COMMANDS]
    torques = np.array([float(drive.torque[0]) for drive in given])
    bias, gain = torques[0], torques[1] - torques[0]
    off = np.abs(torques - bias - gain * np.array(_COMMANDS)).max()
    linear = bool(off <= _ROUNDING * np.abs(torques).max())
    return DriveLaw(float(gain), float(bias), float(given[1].time[0]), given[1].lag, linear)


def apply_drive_effects(effects: Mapping[str, Mapping[str, float]], drive: Drive) -> Drive:
    """What effects make of commanded torques, in their order."""
    for name, p in effects.items():
        drive = REGISTRY[name].drive(drive, p)
    return drive


def nonlinear_drives(effects: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Names of the effects whose drive law is no gain, bias, delay and lag."""
    return tuple(name for name, p in effects.items() if not drive_law({name: p}).linear)
