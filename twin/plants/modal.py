"""The linear model of Bossi et al. 2009 as a plant: n modes, saturation, stick and slip.

Two linear systems share the motion, one with a hub that slides and one with a hub that rests,

    sliding   q_tt = -W q - D q_t + b (tau - sign(theta_t) tau_c)                       theta = c^T q
    resting   q_tt = -(1 - b c^T / c^T b) (W q + D q_t)                                  c^T q_tt = 0

with q = [alpha, delta_1..n] (section III there). Each is moved by its exact propagator exp(M h): torques are held,
so that they are states of rate zero. The hub sticks where its rate crosses zero, if the torque that holds it,

    needed = tau - c^T (W q + D q_t) / c^T b

stays below the static level; it breaks away where that rises above it. Both instants are roots on the propagator.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from twin import mjcf, planar
from twin.beam import modes as beam_modes
from twin.effects import REGISTRY
from twin.errors import InputError
from twin.modal import state_space
from twin.model import Model
from twin.plants.base import PERIOD
from twin.plants.drive import DriveLine

DEFAULT_MODES = 3
_LOOK = 1e-3  # s, longest time without a look for stick and slip: 1/20 of the third mode's period
_SHORT = 1e-9  # s, so that an event never comes twice
_LINEAR = {"static_positive", "static_negative", "coulomb_positive", "coulomb_negative", "bias", "lag"}
_LINEAR |= {"viscous", "cable_stiffness", "cable_rest_angle"}
_OF_RIG = {"lengths", "inertia", "stiffness", "damping", "first_moment", "flexibility", "hub_inertia"}


class ModalPlant:
    """The modes of a rig with its friction; the state is z = [q, q_t, delivered torque, command, other torques]."""

    name = "modal"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = DEFAULT_MODES) -> None:
        """Prepares the modes of a model.

        Args:
          model: rig and effects; effects of the link's mechanics that no linear model has are refused.
          period: sample period [s].
          modes: number of bending modes.

        Raises:
          InputError: an effect cannot be part of a modal model.
        """
        _check_effects(model)
        self.period, self.torque_limit = period, float(model.declared["torque_limit"])
        self._drive, self._levels = DriveLine(model), model.plant
        gauges = [sensor for sensor in model.sensors.values() if sensor.half_thickness > 0]
        system = state_space(model.rig, modes, gauges or mjcf.GAUGES)
        self._size = size = modes + 1
        self._outputs = dict(zip(system.output_labels, np.asarray(system.C)[:, :size], strict=True))
        self._hub = self._outputs["hub_angle"]
        self._push = np.asarray(system.B)[size:, 0]
        self._sliding, self._resting, self._needed = _systems(system, self._hub, self._push, model.plant)
        self._steps: dict[tuple[bool, float], np.ndarray] = {}
        self._along = np.linspace(0.0, model.rig["length"], 25)
        shape = beam_modes(model.rig, modes)
        self._bends = shape.shape(self._along) - np.outer(shape.shape(0.0, 1)[:, 0], self._along)
        self.reset()

    def reset(self, hub_angle: float = 0.0) -> None:
        """Puts the rig to rest at a hub angle [rad], time 0."""
        self._drive.reset()
        self._time, self._mode = 0.0, 0
        self._z = np.zeros(2 * self._size + 3)
        self._z[0] = hub_angle
        self._z[-3:-1] = self._drive.torque

    def advance(self, torque: float) -> None:
        """Moves on by one period under a commanded torque [N m]."""
        self._drive.command(self._time, torque)
        for piece, span in self._drive.pieces(self._time, self.period):
            self._z[-2] = piece
            count = int(np.ceil(span / _LOOK - 1e-9))
            for _ in range(count):
                self._move(span / count)
        self._time += self.period

    def time(self) -> float:
        """Time since the reset [s]."""
        return self._time

    def read(self) -> dict[str, float]:
        """True value of each channel, SI."""
        q = self._z[: self._size]
        values = {name: float(row @ q) for name, row in self._outputs.items()}
        return {**values, "motor_torque": float(self._z[-3 if self._levels.lag > 0 else -2])}

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction in which it slides."""
        return self._mode

    @property
    def configuration(self) -> np.ndarray:
        """alpha [rad] and the amplitudes of the modes [kg^1/2 m]."""
        return self._z[: self._size].copy()

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """25 points along the link (m, 25, 2) [m], hub axis first."""
        theta, bend = configurations @ self._hub, configurations[:, 1:] @ self._bends
        cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
        return np.stack([cos * self._along - sin * bend, sin * self._along + cos * bend], axis=-1)

    # Stick and slip

    def _move(self, span: float) -> None:
        """Moves on by `span` [s], through every stick and slip in it."""
        if self._mode == 0:
            self._break_away()
        left = span
        while left > _SHORT:
            end = self._propagator(left, keep=left == span) @ self._z
            if self._remains(end) >= 0:
                self._z = end
                return
            left -= self._to_event(left)

    def _to_event(self, span: float) -> float:
        """Moves to the end of the present mode, which is within `span` [s], and into the next; returns when it was."""
        start = self._z

        def remains(h: float) -> float:
            return self._remains(self._propagator(h) @ start)

        when = brentq(remains, _SHORT, span, xtol=1e-12) if remains(_SHORT) > 0 else _SHORT
        self._z = self._propagator(when) @ start
        if self._mode == 0:
            self._slide(1 if self._to_hold() > 0 else -1)
        else:
            self._halt()
        return when

    def _remains(self, z: np.ndarray) -> float:
        """What is left in z before the mode ends: rate [rad/s] of a sliding hub, static friction [N m] at rest."""
        if self._mode != 0:
            return self._mode * float(self._hub @ z[self._size : 2 * self._size])
        needed = float(self._needed @ z)
        return self._static(needed) - abs(needed)

    def _break_away(self) -> None:
        if self._remains(self._z) < 0:
            self._slide(1 if self._to_hold() > 0 else -1)

    def _halt(self) -> None:
        """The hub's rate is zero: it sticks, or slides on to the side where the torque pulls it."""
        self._z[-1] = 0.0
        needed = self._to_hold()
        if abs(needed) > self._static(needed):
            self._slide(1 if needed > 0 else -1)
            return
        self._mode = 0
        rates = self._z[self._size : 2 * self._size]
        # What is left of the hub's rate is taken by an impulse on the hub.
        rates -= self._push * (self._hub @ rates) / (self._hub @ self._push)

    def _slide(self, direction: int) -> None:
        self._mode = direction
        level = self._levels.coulomb_positive if direction > 0 else self._levels.coulomb_negative
        self._z[-1] = -direction * level

    def _to_hold(self) -> float:
        return float(self._needed @ self._z)

    def _static(self, needed: float) -> float:
        return self._levels.static_positive if needed > 0 else self._levels.static_negative

    def _propagator(self, h: float, keep: bool = False) -> np.ndarray:
        resting = self._mode == 0
        known = self._steps.get((resting, h))
        if known is None:
            known = expm((self._resting if resting else self._sliding) * h)
            if keep:
                self._steps[resting, h] = known
        return known


def _systems(
    system, hub: np.ndarray, push: np.ndarray, levels: planar.Plant
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M of the sliding and of the resting hub, and the row that gives the torque to hold it (2n + 5)."""
    n = len(hub)
    q, rate, delivered, command, other = slice(0, n), slice(n, 2 * n), 2 * n, 2 * n + 1, 2 * n + 2
    inner = np.asarray(system.A)[n:]
    torque = np.zeros(2 * n + 3)
    torque[q], torque[rate] = -levels.cable_stiffness * hub, -levels.viscous * hub
    torque[delivered if levels.lag > 0 else command] = 1.0
    torque[other] = 1.0
    sliding, resting = np.zeros((2, 2 * n + 3, 2 * n + 3))
    for M in (sliding, resting):
        M[q, rate] = np.eye(n)
        if levels.lag > 0:
            M[delivered, delivered], M[delivered, command] = -1 / levels.lag, 1 / levels.lag
    sliding[rate, : 2 * n] = inner
    sliding[rate] += np.outer(push, torque)
    resting[rate, : 2 * n] = inner - np.outer(push, hub @ inner) / (hub @ push)
    needed = torque.copy()
    needed[: 2 * n] += hub @ inner / (hub @ push)
    return sliding, resting, needed


def _check_effects(model: Model) -> None:
    declared = planar.declared_plant(model.rig, model.chain)
    for name, p in model.effects.items():
        effect = REGISTRY[name]
        changed = effect.plant(declared, p)
        fields = {
            f for f in planar.Plant._fields if not np.array_equal(getattr(changed, f), getattr(declared, f))
        }
        links = effect.links(model.chain, model.rig, p)
        if fields - _LINEAR - _OF_RIG or links is not model.chain:
            raise InputError(f"effect {name} has no place in the modal plant; expected --plant chain for it")
