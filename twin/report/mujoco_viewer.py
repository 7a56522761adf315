"""The rig in MuJoCo's interactive viewer, a controller running in real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

from twin.control import closed_loop, plants, scenarios
from twin.control.experiment import Experiment
from twin.control.plants.chain import ChainPlant
from twin.mechanics import mjcf

_FRAME_RATE = 60  # Hz


class Window(Protocol):
    """What `mujoco.viewer.launch_passive` returns, as far as it is used."""

    def is_running(self) -> bool:
        """False once it was closed."""

    def sync(self) -> None:
        """Draws the present state."""

    def close(self) -> None:
        """Closes the window."""


class _Closed(Exception):
    """The user closed the window."""


def watch(
    experiment: Experiment,
    open_window: Callable[[Any, Any], Window],
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Runs an experiment on the chain in real time, again and again until the window is closed.

    Args:
      experiment: scenario, rig and controller; the plant is MuJoCo's chain.
      open_window: takes a MuJoCo model and its data, returns the window: `mujoco.viewer.launch_passive`.
      clock, sleep: real time [s].

    Raises:
      InputError: there is no such scenario or controller, or the user's controller fails.
    """
    import mujoco

    scenario = scenarios.scenario(experiment.scenario)
    model = plants.make_model(experiment.rig, experiment.effects)
    plant = ChainPlant(model)
    controller = experiment.law(plant.period)
    compiled = mjcf.build_spec(model.rig, model.chain, model.plant, model.hub_torques, scene=True).compile()
    data = mujoco.MjData(compiled)
    window = open_window(compiled, data)

    class Paced:
        """The controller, kept to real time; it draws on its way."""

        def __init__(self) -> None:
            self._began, self._drawn = clock(), -1

        def reset(self) -> None:
            controller.reset()
            self._began, self._drawn = clock(), -1

        def torque(self, measured, wanted) -> float:
            frame = int(measured["time"] * _FRAME_RATE)
            if frame != self._drawn:
                self._drawn = frame
                if not window.is_running():
                    raise _Closed
                data.qpos[: len(plant.joints)] = plant.joints  # behind them, a disturbance has a clock
                mujoco.mj_forward(compiled, data)
                window.sync()
                sleep(max(0.0, self._began + measured["time"] - clock()))
            return controller.torque(measured, wanted)

    try:
        while window.is_running():
            closed_loop.run(plant, Paced(), scenario.reference, scenario.duration)
    except _Closed:
        pass
    finally:
        window.close()
