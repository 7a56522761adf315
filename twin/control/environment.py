"""The rig as a dm_env environment, for closed loops and for learning: dm_control's Physics and Task over a plant.

from twin.control.environment import rig_environment
environment = rig_environment()            # MuJoCo chain of the default rig, a step of 120 degrees
timestep = environment.reset()
timestep = environment.step(0.1)           # torque [N m], held for one sample
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs

from twin.control.plants.base import PERIOD, READINGS, Plant, Reference, wanted_angle
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import Sensors
from twin.errors import InputError, checked_number, quoted
from twin.parameters import Rig
from twin.rigs.patch import Patch

_PERIODS = (1e-5, 0.1)
"""Sample periods [s] with which a hub and its first mode can be controlled."""
_LONGEST = 1e5
"""Longest episode [s]."""
_GOOD = math.radians(0.5)  # rad, error up to which the reward is 1
_POOR = math.radians(30.0)  # rad, further error at which the reward has fallen to 0.1


class PlantPhysics(control.Physics):
    """A plant as a dm_control Physics: one step is one sample period, with stick and slip located inside it."""

    def __init__(self, plant: Plant) -> None:
        """Takes the plant; it is reset with the environment."""
        self.plant = plant
        self._torque = 0.0

    def step(self, n_sub_steps: int = 1) -> None:
        """Advances by `n_sub_steps` sample periods under the torque that was set."""
        for _ in range(n_sub_steps):
            self.plant.advance(self._torque)

    def time(self) -> float:
        """Time since the reset [s]."""
        return self.plant.time()

    def timestep(self) -> float:
        """The sample period [s]."""
        return self.plant.period

    def reset(self) -> None:
        """Resets the rig to rest at zero."""
        self._torque = 0.0
        self.plant.reset()

    def after_reset(self) -> None:
        """Does nothing: no quantities are derived from the state."""

    def set_control(self, torque: Any) -> None:
        """Sets the commanded torque [N m]."""
        self._torque = float(np.asarray(torque).reshape(-1)[0])

    def check_divergence(self) -> None:
        """Raises PhysicsError where a coordinate is not finite."""
        if not np.all(np.isfinite(self.plant.configuration)):
            raise control.PhysicsError("a coordinate of the plant is not finite")


class FollowReference(control.Task):
    """Task: the hub follows a reference. Observations are sensor readings and the reference; the action is a torque.

    The reward is 1 within half a degree of the reference and falls smoothly to 0.1 at another 30 degrees.
    """

    def __init__(self, reference: Reference, sensors: Sensors | None = None) -> None:
        """Takes the reference and the sensors; without sensors, true values are observed."""
        self.reference = reference
        self._sensors = sensors if sensors is not None else Sensors()

    def initialize_episode(self, physics: PlantPhysics) -> None:
        """Restarts the noise from its seed."""
        self._sensors.reset()

    def before_step(self, action: Any, physics: PlantPhysics) -> None:
        """Sets the torque; raises InputError where it is not finite."""
        if not np.all(np.isfinite(action)):
            raise InputError(f"the torque is {action}; expected a finite number of N·m")
        physics.set_control(action)

    def after_step(self, physics: PlantPhysics) -> None:
        """Raises PhysicsError where a coordinate is not finite."""
        physics.check_divergence()

    def action_spec(self, physics: PlantPhysics) -> specs.BoundedArray:
        """Torque [N m] within the amplifier's limit."""
        limit = physics.plant.torque_limit
        return specs.BoundedArray((), float, -limit, limit, name="torque")

    def observation_spec(self, physics: PlantPhysics) -> dict[str, specs.Array]:
        """Every reading, the time [s] and the reference [rad], as numbers."""
        return {name: specs.Array((), float, name=name) for name in (*READINGS, "time", "reference")}

    def get_observation(self, physics: PlantPhysics) -> dict[str, np.ndarray]:
        """Present readings, time and reference."""
        true = physics.plant.read()
        now = physics.time()
        reference = wanted_angle(self.reference, now)
        values = {**self._sensors.read(now, true), "time": now, "reference": reference}
        return {name: np.asarray(value, dtype=float) for name, value in values.items()}

    def get_reward(self, physics: PlantPhysics) -> float:
        """Reward between 0 and 1; see the class."""
        from dm_control.utils import rewards

        error = physics.plant.read()["hub_angle"] - self.reference(physics.time())
        return float(rewards.tolerance(error, (-_GOOD, _GOOD), margin=_POOR))


def make_environment(plant: Plant, task: control.Task, duration: float) -> control.Environment:
    """Returns the environment of a plant and a task, with episodes of `duration` [s]."""
    return control.Environment(PlantPhysics(plant), task, time_limit=duration - plant.period / 2)


def rig_environment(
    rig: Rig | None = None,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    reference: Reference = lambda time: math.radians(120.0),
    duration: float = 5.0,
    period: float = PERIOD,
    sensors: Sensors | None = None,
    patch: Patch | None = None,
) -> control.Environment:
    """Returns the MuJoCo chain of a rig as an environment.

    Args:
      rig: by default `bossi2009`.
      effects: name -> parameter -> value, SI.
      reference: reference of the hub angle [rad] as a function of time [s].
      duration: of an episode [s].
      period: sample period [s].
      sensors: by default without noise and quantisation, with the effects on the readings.
      patch: empirical lookup table; None for none.

    Raises:
      InputError: rig, effects, reference, duration or period cannot be used.
    """
    from twin.control import plants

    checked_number("period", period, *_PERIODS, "s")
    checked_number("duration", duration, period, _LONGEST, "s")
    if not callable(reference):
        raise InputError(f"reference is {quoted(reference)}; expected a function of the time")

    plant = plants.make_plant("chain", rig, effects, period, patch=patch)
    if sensors is None:
        sensors = Sensors(effects=SensorEffects(plants.make_model(rig, effects, patch=patch), plant))
    return make_environment(plant, FollowReference(reference, sensors), duration)
