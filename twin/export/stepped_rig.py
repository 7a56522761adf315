"""The rig in steps under a held command, readings and friction included: what runs inside an FMU."""

from __future__ import annotations

from os import PathLike

import numpy as np

from twin.control.plants.base import READINGS
from twin.control.plants.chain import CompiledPlant
from twin.control.plants.sensor_effects import SensorEffects
from twin.errors import InputError
from twin.rigs.model import Model
from twin.rigs.rig_file import read_rig_file

SHORTEST_STEP = 1e-4
"""Shortest step [s]: the readings of a late sensor are kept for its longest delay in steps of this length."""


class SteppedRig:
    """The compiled chain with its drive and sensors, from rest at a hub angle.

    Attributes:
      name: of the rig.
      readings: channel -> what its sensor reports now, SI.
    """

    def __init__(self, model: Model, hub_angle: float = 0.0) -> None:
        """Takes the model with its effects, and the hub angle from which it starts [rad]."""
        self.name = model.declared.name
        self._plant = CompiledPlant(model, SHORTEST_STEP)
        self._sensors = SensorEffects(model, self._plant)
        self.reset(hub_angle)

    def reset(self, hub_angle: float) -> None:
        """Puts the rig to rest at a hub angle [rad], time 0."""
        self._plant.reset(hub_angle)
        self._sensors.reset()
        self._read()

    def advance(self, torque: float, span: float) -> None:
        """Advances by a span [s] under a held command [N m].

        Raises:
          InputError: the span is too short, or the motion is no longer finite.
        """
        if not span >= SHORTEST_STEP * (1 - 1e-9):
            raise InputError(f"the step is {span:g} s; expected at least {SHORTEST_STEP:g} s")
        self._plant.period = span
        self._plant.advance(torque)
        if not np.isfinite(self._plant.configuration).all():
            raise InputError(
                f"the simulation diverged at {self._plant.time():g} s: check the units of the command"
            )
        self._read()

    @property
    def sticks(self) -> bool:
        """Whether dry friction holds the hub."""
        return self._plant.mode == 0

    def _read(self) -> None:
        reported = self._sensors.read(self._plant.time(), self._plant.read())
        self.readings = {name: reported[name] for name in READINGS}


def from_file(path: str | PathLike[str]) -> SteppedRig:
    """Returns the rig of a parameter file at rest at a hub angle of 0.

    Raises:
      InputError: the file cannot be used.
    """
    from twin.control.plants import make_model

    return SteppedRig(make_model(*read_rig_file(path)))
