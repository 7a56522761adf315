"""The linear model of Bossi et al. 2009 as a plant: n modes, saturation, stick and slip.

Two linear systems share the motion, one with a hub that slides and one with a hub that rests,

    sliding   q_tt = a + b (tau - sign(theta_t) tau_c)       a = M^-1 (f - K q - D q_t)       theta = c^T q
    resting   q_tt = (1 - b c^T / c^T b) a                   b = M^-1 c                       c^T q_tt = 0

with q = [alpha, delta_1..n] (section III there) and what effects add to it (`modal_rig`). Each is moved by its exact
propagator exp(A h): torques and loads f are held, so that they are states of rate zero. The hub sticks where its
rate crosses zero, if the torque that holds it,

    needed = tau + c^T a / c^T b

stays below the static level; it breaks away where that rises above it. Both instants are roots on the propagator.

Forces that vary with state or time (`modal_forces`) are held over steps of 1 ms at most as they are in the middle of
each, where half a step with those of its start leads: of second order, in the instants of stick and slip too.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from twin.control.plants.base import PERIOD
from twin.control.plants.drive import DriveLine
from twin.control.plants.modal_forces import Forces
from twin.control.plants.modal_rig import ModalRig, modal_rig
from twin.errors import InputError
from twin.rigs.model import Model

DEFAULT_MODES = 3
_LOOK = 1e-3  # s, longest time without a look for stick and slip: 1/20 of the third mode's period
_SHORT = 1e-9  # s, so that an event never comes twice


class ModalPlant:
    """The modes of a rig with its friction; the state is z = [q, q_t, delivered, command, other torques, loads]."""

    name = "modal"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = DEFAULT_MODES) -> None:
        """Prepares the modes of a model.

        Args:
          model: rig and effects. A play is refused: its flanks are too stiff for forces that are held.
          period: sample period [s].
          modes: number of bending modes.

        Raises:
          InputError: there is a play between motor and hub.
        """
        _check_effects(model, self.name)
        self.period, self.torque_limit = period, float(model.declared["torque_limit"])
        self._drive, self._lags = DriveLine(model), model.plant.motor.lag > 0
        rig = modal_rig(model, modes)
        self._forces = Forces(model, rig)
        self._outputs, self._hub, self._twist = rig.outputs, rig.hub, rig.twist
        self._size = size = len(rig.mass)
        self._delivered, self._command, self._other = 2 * size, 2 * size + 1, 2 * size + 2
        self._push = np.linalg.solve(rig.mass, rig.hub)
        self._sliding, self._resting, self._needed = _systems(rig, self._push, model, self._forces.loads)
        self._steps: dict[tuple[bool, float], np.ndarray] = {}
        self._look = min(_LOOK, model.step)
        self._along = np.linspace(0.0, model.rig["length"], 25)
        self._bends = rig.link(self._along) - np.outer(self._hub, self._along)
        self.reset()

    def reset(self, hub_angle: float = 0.0) -> None:
        """Puts the rig to rest at a hub angle [rad], time 0."""
        self._drive.reset()
        self._time = self._now = 0.0
        self._mode = 0
        self._z = np.zeros(len(self._needed))
        self._z[: self._size] = self._forces.hanging(hub_angle)
        self._z[self._delivered : self._other] = self._drive.torque
        self._hold(self._z, self._now)

    def advance(self, torque: float) -> None:
        """Moves on by one period under a commanded torque [N m]."""
        self._drive.command(self._time, torque)
        for piece, span in self._drive.constant_spans(self._time, self.period):
            self._z[self._command] = piece
            count = int(np.ceil(span / self._look - 1e-9))
            for _ in range(count):
                self._move(span / count)
        self._time += self.period
        self._now = self._time

    def time(self) -> float:
        """Time since the reset [s]."""
        return self._time

    def read(self) -> dict[str, float]:
        """True value of each channel, SI."""
        q = self._z[: self._size]
        values = {name: float(row @ q) for name, row in self._outputs.items()}
        return {**values, "motor_torque": self._motor_torque(self._z)}

    @property
    def twist(self) -> float:
        """Angle of a torsional mode against the hub [rad]."""
        return float(self._twist @ self._z[: self._size])

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction in which it slides."""
        return self._mode

    @property
    def configuration(self) -> np.ndarray:
        """alpha [rad], the amplitudes of the modes [kg^1/2 m], angles that effects add [rad]."""
        return self._z[: self._size].copy()

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """25 points along the link (m, 25, 2) [m], hub axis first."""
        theta, bend = configurations @ self._hub, configurations @ self._bends
        cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
        return np.stack([cos * self._along - sin * bend, sin * self._along + cos * bend], axis=-1)

    # Stick and slip

    def _move(self, span: float) -> None:
        """Moves on by `span` [s], through every stick and slip in it."""
        if self._mode == 0:
            self._break_away()
        left = span
        while left > _SHORT:
            end = self._after(left, keep=left == span)
            if self._remains(end) >= 0:
                self._z = end
                self._now += left
                return
            left -= self._to_event(left)

    def _to_event(self, span: float) -> float:
        """Moves to the end of the present mode, which is within `span` [s], and into the next; returns when it was."""

        def remains(h: float) -> float:
            return self._remains(self._after(h))

        when = brentq(remains, _SHORT, span, xtol=1e-12) if remains(_SHORT) > 0 else _SHORT
        self._z = self._after(when)
        self._now += when
        if self._mode == 0:
            self._slide(1 if self._to_hold() > 0 else -1)
        else:
            self._halt()
        return when

    def _after(self, h: float, keep: bool = False) -> np.ndarray:
        """The state after h [s] in the present mode."""
        if not self._forces.vary:
            return self._propagator(h, keep) @ self._z
        half = self._hold(self._propagator(h / 2, keep) @ self._z, self._now + h / 2)
        middle = np.r_[self._z[: self._other], half[self._other :]]
        return self._hold(self._propagator(h, keep) @ middle, self._now + h)

    def _hold(self, z: np.ndarray, time: float) -> np.ndarray:
        """Puts the forces of a state into it, as they are at a time [s] in the present mode."""
        q, rates = z[: self._size], z[self._size : 2 * self._size]
        z[self._other] = self._forces.on_hub(time, q, rates, self._mode)
        if self._forces.loads:
            z[self._other + 1 :] = self._forces.along_link(time, q, rates)
        return z

    def _remains(self, z: np.ndarray) -> float:
        """What is left in z before the mode ends: rate [rad/s] of a sliding hub, static friction [N m] at rest."""
        if self._mode != 0:
            return self._mode * float(self._hub @ z[self._size : 2 * self._size])
        return self._held(z)

    def _held(self, z: np.ndarray) -> float:
        """How much more torque [N m] a hub at rest withstands in the state z; negative where it breaks away."""
        needed = float(self._needed @ z)
        return self._forces.static(z[: self._size], 1 if needed > 0 else -1) - abs(needed)

    def _break_away(self) -> None:
        if self._remains(self._z) < 0:
            self._slide(1 if self._to_hold() > 0 else -1)

    def _halt(self) -> None:
        """The hub's rate is zero: it sticks, or slides on to the side where the torque pulls it."""
        self._mode = 0
        self._hold(self._z, self._now)
        if self._held(self._z) < 0:
            self._slide(1 if self._to_hold() > 0 else -1)
            return
        rates = self._z[self._size : 2 * self._size]
        # What is left of the hub's rate is taken by an impulse on the hub.
        rates -= self._push * (self._hub @ rates) / (self._hub @ self._push)

    def _slide(self, direction: int) -> None:
        self._mode = direction
        self._hold(self._z, self._now)

    def _to_hold(self) -> float:
        return float(self._needed @ self._z)

    def _motor_torque(self, z: np.ndarray) -> float:
        return float(z[self._delivered if self._lags else self._command])

    def _propagator(self, h: float, keep: bool = False) -> np.ndarray:
        resting = self._mode == 0
        known = self._steps.get((resting, h))
        if known is None:
            known = expm((self._resting if resting else self._sliding) * h)
            if keep:
                self._steps[resting, h] = known
        return known


def _systems(
    rig: ModalRig, push: np.ndarray, model: Model, loads: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A of the sliding and of the resting hub, and the row that gives the torque to hold it (2n + 3 + loads)."""
    n, hub = len(rig.mass), rig.hub
    q, rate, delivered, command, other = slice(0, n), slice(n, 2 * n), 2 * n, 2 * n + 1, 2 * n + 2
    torque = np.zeros(2 * n + 3 + loads)
    for part in (law.linear for law in model.hub_torques):
        if part is not None:
            torque[q] -= part.stiffness * hub
            torque[rate] -= part.damping * hub
    lag = model.plant.motor.lag
    torque[delivered if lag > 0 else command] = 1.0
    torque[other] = 1.0
    inner = np.zeros((n, len(torque)))
    inner[:, : 2 * n] = np.linalg.solve(rig.mass, -np.hstack([rig.stiffness, rig.damping]))
    inner[:, other + 1 :] = np.linalg.inv(rig.mass)[:, :loads]
    sliding, resting = np.zeros((2, len(torque), len(torque)))
    for A in (sliding, resting):
        A[q, rate] = np.eye(n)
        if lag > 0:
            A[delivered, delivered], A[delivered, command] = -1 / lag, 1 / lag
    sliding[rate] = inner + np.outer(push, torque)
    resting[rate] = inner - np.outer(push, hub @ inner) / (hub @ push)
    return sliding, resting, torque + hub @ inner / (hub @ push)


def _check_effects(model: Model, plant: str) -> None:
    if model.plant.motor.gap > 0:
        raise InputError(f"effect backlash has no place in the {plant} plant; expected --plant chain for it")
