"""A controller on a plant: one closed-loop run, recorded completely.

Sample k is read at t_k = k * period; the torque that the controller computes from it is held until t_{k+1}.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from twin.control.laws.base import Controller
from twin.control.plants.base import READINGS, Plant, Reference, wanted_angle
from twin.control.plants.sensors import Sensors
from twin.errors import InputError
from twin.recording import Recording

_PIECE = 0.5  # s, length of the pieces of a run that are passed to `watch`


class DivergenceError(InputError):
    """The motion of a plant is no longer finite: an unstable controller, or parameters beyond what can be simulated."""


@dataclass(frozen=True)
class Run:
    """One run; m samples, k points along the link.

    Attributes:
      plant: name of the plant.
      time: (m) [s].
      reference: (m) reference of the hub angle [rad].
      torque_command: (m) torque that the controller computed [N m]; the last one is never applied.
      true: channel -> (m) true values, SI.
      measured: channel -> (m) sensor readings, SI.
      modes: (m) 0 while the hub sticks, else the direction +1 or -1 in which it slides.
      states: name -> (m) states that the controller reports; NaN at samples without a report of one.
      outline: (m, k, 2) centre line of the link [m].
      torque_limit: of the amplifier [N m].
      wall: wall-clock time of the loop [s].
    """

    plant: str
    time: np.ndarray
    reference: np.ndarray
    torque_command: np.ndarray
    true: Mapping[str, np.ndarray] = field(repr=False)
    measured: Mapping[str, np.ndarray] = field(repr=False)
    modes: np.ndarray
    states: Mapping[str, np.ndarray] = field(repr=False)
    outline: np.ndarray = field(repr=False)
    torque_limit: float
    wall: float

    def recording(self, name: str) -> Recording:
        """Returns the run as a recording of command, reference and sensor readings."""
        channels = {"torque_command": self.torque_command, "hub_reference": self.reference, **self.measured}
        return Recording(name, self.time, channels, loop="closed")


class _Log:
    """Collects the samples of a run."""

    def __init__(self) -> None:
        self.rows: list[tuple] = []

    def add(
        self, plant: Plant, observation: Mapping[str, Any], torque: float, states: Mapping[str, float]
    ) -> None:
        """Adds a sample: readings and reference of an environment, torque command, states of the controller."""
        values = {name: float(value) for name, value in observation.items()}
        self.rows.append((values, plant.read(), torque, dict(states), plant.mode, plant.configuration))

    def run(self, plant: Plant, wall: float, first: int = 0) -> Run:
        """Returns the run from sample `first` on; `wall` [s] is the time it took."""
        values, true, torque, states, modes, configurations = zip(*self.rows[first:], strict=True)
        return Run(
            plant.name,
            _column(values, "time"),
            _column(values, "reference"),
            np.array(torque),
            {name: _column(true, name) for name in READINGS},
            {name: _column(values, name) for name in READINGS},
            np.array(modes),
            {name: _column(states, name) for name in dict.fromkeys(chain.from_iterable(states))},
            plant.outline(np.array(configurations)),
            plant.torque_limit,
            wall,
        )


def run(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    duration: float,
    sensors: Sensors | None = None,
    watch: Callable[[Run], None] | None = None,
) -> Run:
    """Runs a controller on a plant from rest at zero; both are reset.

    Args:
      plant: the plant.
      controller: called at every sample.
      reference: reference of the hub angle [rad] as a function of time [s].
      duration: of the run [s].
      sensors: sensors between plant and controller; None for true values.
      watch: called every half second of the run, and at its end, with the new piece of it.

    Raises:
      InputError: a user's controller fails.
      DivergenceError: a coordinate of the plant is no longer finite.
    """
    sensors = sensors if sensors is not None else Sensors()
    plant.reset()
    sensors.reset()
    controller.reset()
    log, watched, began = _Log(), 0, time.perf_counter()
    steps = math.ceil((duration - plant.period / 2) / plant.period)
    for step in range(steps + 1):
        readings = {**sensors.read(plant.time(), plant.read()), "time": plant.time()}
        target = wanted_angle(reference, plant.time())
        torque = float(controller.torque(dict(readings), target))
        log.add(plant, {**readings, "reference": target}, torque, getattr(controller, "states", {}))
        if watch is not None and (step == steps or len(log.rows) - watched >= _PIECE / plant.period):
            watch(log.run(plant, time.perf_counter() - began, watched))
            watched = len(log.rows)
        if step < steps:
            plant.advance(torque)
            _check_divergence(plant)
    return log.run(plant, time.perf_counter() - began)


def _check_divergence(plant: Plant) -> None:
    if not np.all(np.isfinite(plant.configuration)):
        raise DivergenceError(
            f"the {plant.name} diverged at {plant.time():g} s: a coordinate is not finite; expected a controller and "
            "a rig whose motion stays bounded: check the units of gains, stiffnesses and torques"
        )


def _column(rows: tuple[Mapping[str, float], ...], name: str) -> np.ndarray:
    return np.array([row.get(name, np.nan) for row in rows], dtype=float)
