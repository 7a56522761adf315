"""The chain as a plant: simulated by MuJoCo, the reference, or by the compiled equations of the same chain."""

from __future__ import annotations

import abc

import numpy as np

from twin.control.plants.base import PERIOD
from twin.control.plants.drive import DriveLine
from twin.mechanics import planar
from twin.mechanics.mujoco_chain import MujocoChain
from twin.rigs.model import Model
from twin.rigs.simulate import gravity_equilibrium


class _SegmentPlant(abc.ABC):
    """Common part of both: the model, its drive, and readings as functions of the segments' angles."""

    def __init__(self, model: Model, period: float) -> None:
        """Takes the model and the sample period [s]."""
        self.period, self.torque_limit = period, float(model.declared["torque_limit"])
        self._model, self._drive = model, DriveLine(model)
        self._lengths = model.chain.lengths
        self._count = len(self._lengths)
        self._rows = {name: row for name, row in model.strain_rows.items() if name.startswith("strain")}

    @property
    @abc.abstractmethod
    def configuration(self) -> np.ndarray:
        """Absolute angles of all coordinates (n + 1 + k) [rad]."""

    @abc.abstractmethod
    def _delivered(self) -> float:
        """Present torque of the motor, lag included [N m]."""

    def read(self) -> dict[str, float]:
        """Returns the present true value of each channel, SI."""
        angles = self.configuration[: self._count]
        hinges = np.diff(angles)
        return {
            "hub_angle": float(angles[0]),
            "tip_deflection": float(self._lengths @ np.sin(angles - angles[0])),
            **{name: float(row @ hinges) for name, row in self._rows.items()},
            "motor_torque": self._delivered(),
        }

    @property
    def twist(self) -> float:
        """Angle of a torsional mode relative to the hub [rad]."""
        if self._model.plant.link.torsion_stiffness <= 0:
            return 0.0
        angles = self.configuration
        return float(angles[self._count] - angles[0])

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """Returns the ends of the segments (m, n + 2, 2) [m], hub axis first."""
        angles = configurations[:, : self._count]
        steps = self._lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return np.concatenate([np.zeros((len(angles), 1, 2)), np.cumsum(steps, axis=1)], axis=1)

    def _at_rest(self, hub_angle: float) -> np.ndarray:
        """Absolute angles (n + 1 + k) [rad] of the link in static equilibrium at a hub angle [rad]."""
        bends = gravity_equilibrium(self._model, hub_angle)
        return self._model.plant.extend_state(hub_angle + np.r_[0.0, np.cumsum(bends)])


class ChainPlant(_SegmentPlant):
    """The chain simulated by MuJoCo, with stick and slip located inside a step."""

    name = "chain"

    def __init__(self, model: Model, period: float = PERIOD) -> None:
        """Compiles the chain of a model with its effects; `period` is the sample period [s]."""
        super().__init__(model, period)
        self._engine = MujocoChain(model.rig, model.chain, model.plant, model.hub_torques)
        self._step = min(model.step, model.chain.largest_step())
        self.reset()

    def reset(self, hub_angle: float = 0.0) -> None:
        """Resets the rig to rest at a hub angle [rad], time 0."""
        self._drive.reset()
        self._engine.reset(self._at_rest(hub_angle), torque=self._drive.torque)

    def advance(self, torque: float) -> None:
        """Advances by one period under a commanded torque [N m]."""
        self._drive.command(self._engine.time, torque)
        for piece, span in self._drive.constant_spans(self._engine.time, self.period):
            self._engine.advance(piece, span, self._step)

    def time(self) -> float:
        """Time since the reset [s]."""
        return self._engine.time

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction in which it slides."""
        return self._engine.mode

    @property
    def configuration(self) -> np.ndarray:
        """Absolute angles of all coordinates (n + 1 + k) [rad]."""
        return self._engine.angles

    @property
    def joints(self) -> np.ndarray:
        """Joint angles (n + 1) [rad]: qpos of the model of `mjcf.build_spec`."""
        return self._engine.joints

    def _delivered(self) -> float:
        return self._engine.torque


class CompiledPlant(_SegmentPlant):
    """The same chain in compiled equations of motion, several times faster: for many runs."""

    name = "compiled"

    def __init__(self, model: Model, period: float = PERIOD) -> None:
        """Takes a model with its effects; `period` is the sample period [s]."""
        super().__init__(model, period)
        self._plant = model.plant
        self._step = model.stable_step
        size = len(self._plant.link.lengths)
        self._work, self._scratch = np.empty((11, size)), np.empty((size + 3, size))
        self.reset()

    def reset(self, hub_angle: float = 0.0) -> None:
        """Resets the rig to rest at a hub angle [rad], time 0."""
        self._drive.reset()
        self._phi = self._at_rest(hub_angle)
        self._omega = np.zeros(len(self._phi))
        self._time, self._mode, self._torque = 0.0, 0, self._drive.torque

    def advance(self, torque: float) -> None:
        """Advances by one period under a commanded torque [N m]."""
        self._drive.command(self._time, torque)
        for piece, span in self._drive.constant_spans(self._time, self.period):
            self._mode, _ = planar.advance(
                self._plant,
                self._time,
                self._time + span,
                self._phi,
                self._omega,
                piece,
                self._torque,
                0.0,
                self._mode,
                False,
                self._step,
                planar.NO_ROWS,
                0,
                self._work,
                self._scratch,
            )
            self._time += span
            lag = self._plant.motor.lag
            self._torque = piece + (self._torque - piece) * np.exp(-span / lag) if lag > 0 else piece

    def time(self) -> float:
        """Time since the reset [s]."""
        return self._time

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction in which it slides."""
        return self._mode

    @property
    def configuration(self) -> np.ndarray:
        """Absolute angles of all coordinates (n + 1 + k) [rad]."""
        return self._phi.copy()

    def _delivered(self) -> float:
        return float(self._torque)
