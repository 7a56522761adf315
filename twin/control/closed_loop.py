"""A controller on a plant: one run, recorded whole.

Sample k is read at t_k = k * period; the controller's torque for it is held until t_{k+1}.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.control.environment import FollowReference, Reference, make_environment
from twin.control.laws.base import Controller
from twin.control.plants.base import READINGS, Plant
from twin.control.plants.sensors import Sensors
from twin.recording import Recording

_PIECE = 0.5  # s of a run, watched at a time


@dataclass(frozen=True)
class Run:
    """One run; m samples, k points along the link.

    Attributes:
      plant: its name.
      time: (m) [s].
      reference: (m) wanted hub angle [rad].
      torque_command: (m) what the controller asked for [N m]; the last is never applied.
      true: channel -> (m) true values, SI.
      measured: channel -> (m) what the sensors read, SI.
      modes: (m) 0 while the hub sticks, else the direction in which it slides.
      states: name -> (m) what the controller says of its state.
      outline: (m, k, 2) centre line of the link [m].
      torque_limit: of the amplifier [N m].
      wall: time that the loop took [s].
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
        """What the sensors and the command line of the rig would have recorded."""
        channels = {"torque_command": self.torque_command, "hub_reference": self.reference, **self.measured}
        return Recording(name, self.time, channels, loop="closed")


class _Log:
    """Rows of a run while it goes on."""

    def __init__(self) -> None:
        self.rows: list[tuple] = []

    def add(
        self, plant: Plant, observation: Mapping[str, Any], torque: float, states: Mapping[str, float]
    ) -> None:
        values = {name: float(value) for name, value in observation.items()}
        self.rows.append((values, plant.read(), torque, dict(states), plant.mode, plant.configuration))

    def run(self, plant: Plant, wall: float, first: int = 0) -> Run:
        """The run from row `first` on."""
        values, true, torque, states, modes, configurations = zip(*self.rows[first:], strict=True)
        return Run(
            plant.name,
            _column(values, "time"),
            _column(values, "reference"),
            np.array(torque),
            {name: _column(true, name) for name in READINGS},
            {name: _column(values, name) for name in READINGS},
            np.array(modes),
            {name: _column(states, name) for name in states[-1]},
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
      plant: what it acts on.
      controller: called at every sample.
      reference: wanted hub angle [rad] by time [s].
      duration: of the run [s].
      sensors: what the controller's readings pass through; without, they are true.
      watch: called every half second of the run, and at its end, with the piece that is new.

    Raises:
      InputError: the controller of a user cannot be used.
    """
    environment = make_environment(plant, FollowReference(reference, sensors), duration)
    controller.reset()
    log, seen, began = _Log(), 0, time.perf_counter()
    step = environment.reset()
    while True:
        readings = {name: float(value) for name, value in step.observation.items()}
        wanted = readings.pop("reference")
        torque = float(controller.torque(readings, wanted))
        log.add(plant, step.observation, torque, getattr(controller, "states", {}))
        if watch is not None and (step.last() or len(log.rows) - seen >= _PIECE / plant.period):
            watch(log.run(plant, time.perf_counter() - began, seen))
            seen = len(log.rows)
        if step.last():
            return log.run(plant, time.perf_counter() - began)
        step = environment.step(torque)


def _column(rows: tuple[Mapping[str, float], ...], name: str) -> np.ndarray:
    return np.array([row.get(name, np.nan) for row in rows], dtype=float)
