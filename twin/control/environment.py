"""The rig as a dm_env environment, for closed loops and for learning: dm_control's Physics and Task over a plant.

from twin.environment import rig_environment
environment = rig_environment()            # MuJoCo chain of the default rig, a step of 120 degrees
timestep = environment.reset()
timestep = environment.step(0.1)           # torque [N m], held for one sample
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs

from twin.control.plants.base import PERIOD, READINGS, Plant
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import Sensors
from twin.parameters import Rig
from twin.rigs.patch import Patch

Reference = Callable[[float], float]
"""Wanted hub angle [rad] at a time [s]."""

_GOOD = math.radians(0.5)  # rad, error of full reward
_POOR = math.radians(30.0)  # rad, error further out at which 0.1 of it is left


class PlantPhysics(control.Physics):
    """A plant as dm_control sees it: one step is one sample period, friction's events located inside."""

    def __init__(self, plant: Plant) -> None:
        """Takes the plant; it is reset with the environment."""
        self.plant = plant
        self._torque = 0.0

    def step(self, n_sub_steps: int = 1) -> None:
        """Moves on by sample periods under the torque that was set."""
        for _ in range(n_sub_steps):
            self.plant.advance(self._torque)

    def time(self) -> float:
        """Time since the reset [s]."""
        return self.plant.time()

    def timestep(self) -> float:
        """The sample period [s]."""
        return self.plant.period

    def reset(self) -> None:
        """Puts the rig to rest at zero."""
        self._torque = 0.0
        self.plant.reset()

    def after_reset(self) -> None:
        """Nothing is derived from the state."""

    def set_control(self, torque: Any) -> None:
        """Sets the commanded torque [N m]."""
        self._torque = float(np.asarray(torque).reshape(-1)[0])

    def check_divergence(self) -> None:
        """Raises PhysicsError where a coordinate is not finite."""
        if not np.all(np.isfinite(self.plant.configuration)):
            raise control.PhysicsError("a coordinate of the plant is not finite")


class FollowReference(control.Task):
    """The hub follows a reference: the observation is what sensors read, and the reference; the action a torque.

    The reward is 1 within half a degree of the reference and falls off smoothly, to 0.1 another 30 degrees out.
    """

    def __init__(self, reference: Reference, sensors: Sensors | None = None) -> None:
        """Takes the reference and the sensors; without sensors the true values are observed."""
        self.reference = reference
        self._sensors = sensors if sensors is not None else Sensors()

    def initialize_episode(self, physics: PlantPhysics) -> None:
        """Starts the noise again."""
        self._sensors.reset()

    def before_step(self, action: Any, physics: PlantPhysics) -> None:
        """Sets the torque."""
        physics.set_control(action)

    def after_step(self, physics: PlantPhysics) -> None:
        """Raises PhysicsError where the motion is no longer finite."""
        physics.check_divergence()

    def action_spec(self, physics: PlantPhysics) -> specs.BoundedArray:
        """Torque [N m] within the amplifier's limits."""
        limit = physics.plant.torque_limit
        return specs.BoundedArray((), float, -limit, limit, name="torque")

    def observation_spec(self, physics: PlantPhysics) -> dict[str, specs.Array]:
        """Every reading, the time [s] and the reference [rad], as numbers."""
        return {name: specs.Array((), float, name=name) for name in (*READINGS, "time", "reference")}

    def get_observation(self, physics: PlantPhysics) -> dict[str, np.ndarray]:
        """Readings, time and reference now."""
        true = physics.plant.read()
        now = physics.time()
        reference = self.reference(now)
        values = {**self._sensors.read(now, true), "time": now, "reference": reference}
        return {name: np.asarray(value, dtype=float) for name, value in values.items()}

    def get_reward(self, physics: PlantPhysics) -> float:
        """Between 0 and 1; see the class."""
        from dm_control.utils import rewards

        error = physics.plant.read()["hub_angle"] - self.reference(physics.time())
        return float(rewards.tolerance(error, (-_GOOD, _GOOD), margin=_POOR))


def make_environment(plant: Plant, task: control.Task, duration: float) -> control.Environment:
    """Returns the environment of a plant and a task that ends after `duration` [s]."""
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
      effects: effects that act, as a diagnosis names them.
      reference: wanted hub angle [rad] by time [s].
      duration: of an episode [s].
      period: sample period [s].
      sensors: noise and resolution; by default none, but what the effects make of the readings.
      patch: a correction without a cause, looked up; None for none.
    """
    from twin.control import plants

    plant = plants.make_plant("chain", rig, effects, period, patch=patch)
    if sensors is None:
        sensors = Sensors(reporting=SensorEffects(plants.make_model(rig, effects, patch=patch), plant))
    return make_environment(plant, FollowReference(reference, sensors), duration)
