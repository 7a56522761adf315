"""A controlled rig in MuJoCo's interactive viewer, in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from twin.control import closed_loop, plants, scenarios
from twin.control.experiment import Experiment
from twin.control.laws.base import Controller
from twin.control.plants.chain import ChainPlant
from twin.mechanics import mjcf
from twin.rigs.model import Model

_FRAME_RATE = 60  # Hz


class Window(Protocol):
    """The part of what `mujoco.viewer.launch_passive` returns that is used here."""

    def is_running(self) -> bool:
        """Whether the window is still open."""

    def sync(self) -> None:
        """Draws the present state."""

    def close(self) -> None:
        """Closes the window."""


class _WindowClosed(Exception):
    """The user closed the window."""


class _Scene:
    """The chain in a window.

    Args:
      model: rig and effects.
      plant: whose joint angles are drawn.
      open_window: takes a MuJoCo model and its data, returns the window.
    """

    def __init__(self, model: Model, plant: ChainPlant, open_window: Callable[[Any, Any], Window]) -> None:
        import mujoco

        spec = mjcf.build_spec(model.rig, model.chain, model.plant, model.hub_torques, scene=True)
        self._plant = plant
        self._compiled = spec.compile()
        self._data = mujoco.MjData(self._compiled)
        self._forward = mujoco.mj_forward
        self.window = open_window(self._compiled, self._data)

    def draw(self) -> None:
        """Draws the present state of the plant.

        Raises:
          _WindowClosed: the window is closed.
        """
        if not self.window.is_running():
            raise _WindowClosed
        # The joints come first; behind them a disturbance has a clock of its own.
        self._data.qpos[: len(self._plant.joints)] = self._plant.joints
        self._forward(self._compiled, self._data)
        self.window.sync()


class _PacedController:
    """A controller that keeps a run to real time and draws its frames.

    Args:
      controller: computes the torque.
      scene: is drawn at `_FRAME_RATE`.
      clock, sleep: real time [s].
    """

    def __init__(
        self,
        controller: Controller,
        scene: _Scene,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._controller, self._scene = controller, scene
        self._clock, self._sleep = clock, sleep
        self._began, self._frame = clock(), -1

    def reset(self) -> None:
        """Resets the controller and the clock."""
        self._controller.reset()
        self._began, self._frame = self._clock(), -1

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; waits, and draws, when a new frame is due."""
        frame = int(measured["time"] * _FRAME_RATE)
        if frame != self._frame:
            self._frame = frame
            self._scene.draw()
            self._sleep(max(0.0, self._began + measured["time"] - self._clock()))
        return self._controller.torque(measured, reference)


def watch(
    experiment: Experiment,
    open_window: Callable[[Any, Any], Window],
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Runs an experiment on the chain in real time, repeatedly until the window is closed.

    Args:
      experiment: scenario, rig and controller; the plant is MuJoCo's chain.
      open_window: takes a MuJoCo model and its data, returns the window: `mujoco.viewer.launch_passive`.
      clock, sleep: real time [s].

    Raises:
      InputError: there is no such scenario or controller, or the user's controller fails.
    """
    scenario = scenarios.scenario(experiment.scenario)
    model = plants.make_model(experiment.rig, experiment.effects)
    plant = ChainPlant(model)
    controller = experiment.law(plant.period)
    scene = _Scene(model, plant, open_window)
    try:
        while scene.window.is_running():
            paced = _PacedController(controller, scene, clock, sleep)
            closed_loop.run(plant, paced, scenario.reference, scenario.duration)
    except _WindowClosed:
        pass
    finally:
        scene.window.close()
