"""One closed-loop experiment: a scenario on a plant under a controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from twin.control import closed_loop, plants, scenarios
from twin.control.closed_loop import Run
from twin.control.laws import library
from twin.control.laws.base import Controller
from twin.control.plants.sensor_effects import SensorEffects
from twin.control.plants.sensors import BOSSI2009, Sensors
from twin.errors import checked_count
from twin.parameters import Rig
from twin.rigs.patch import Patch

LARGEST_SEED = 2**128 - 1
"""Largest seed of random numbers: numpy's generators have 128 bits."""


@dataclass(frozen=True)
class Experiment:
    """Scenario, plant and controller of an experiment.

    Attributes:
      scenario: name of a scenario.
      plant: one of `plants.KINDS`.
      rig: parameters of the plant; controllers are designed for them.
      effects: effects on the plant: name -> parameter -> value, SI; controllers do not know them.
      controller: name or FILE.py:NAME; None for the scenario's own.
      noise: seed of the sensors' noise; None for no noise and quantisation.
      patch: empirical lookup table; None for none.

    Raises:
      InputError: the seed is no whole number from 0 to 2^128 - 1.
    """

    scenario: str
    plant: str
    rig: Rig
    effects: Mapping[str, Mapping[str, float]]
    controller: str | None = None
    noise: int | None = None
    patch: Patch | None = None

    def __post_init__(self) -> None:
        if self.noise is not None:
            checked_count("noise", self.noise, 0, LARGEST_SEED)

    @property
    def controller_name(self) -> str:
        """Name of the controller that is used."""
        return self.controller or scenarios.scenario(self.scenario).controller

    def run(self, watch: Callable[[Run], None] | None = None) -> Run:
        """Runs the experiment; `watch` as in `closed_loop.run`.

        Raises:
          InputError: there is no such scenario, plant or controller, or the user's controller fails.
        """
        chosen = scenarios.scenario(self.scenario)
        plant = plants.make_plant(self.plant, self.rig, self.effects, patch=self.patch)
        on_sensors = SensorEffects(plants.make_model(self.rig, self.effects, patch=self.patch), plant)
        sensors = Sensors({} if self.noise is None else BOSSI2009, self.noise or 0, on_sensors)
        law = self.law(plant.period)
        # With such small matrices, several threads of linear algebra are slower than one.
        with threadpool_limits(1):
            return closed_loop.run(plant, law, chosen.reference, chosen.duration, sensors, watch)

    def law(self, period: float) -> Controller:
        """Returns the controller for a sample period [s]."""
        if self.controller is None:
            return scenarios.scenario(self.scenario).own_controller(self.rig, period)
        return library.controller(self.controller, self.rig, period)

    def metrics(self, run: Run) -> dict[str, float]:
        """Returns the figures of a run of this experiment; see `scenarios.metrics`."""
        return scenarios.metrics(run, scenarios.scenario(self.scenario).from_half)
