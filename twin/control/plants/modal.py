"""The linear model of Bossi et al. 2009 as a plant: n modes, saturation, stick and slip.

Two linear systems alternate, one while the hub slides and one while it rests,

    sliding   q_tt = a + b (tau - sign(theta_t) tau_c)       a = M^-1 (f - K q - D q_t)       theta = c^T q
    resting   q_tt = (1 - b c^T / c^T b) a                   b = M^-1 c                       c^T q_tt = 0

with q = [alpha, delta_1..n] (section III there) and coordinates that effects append (`modal_rig`). Each is integrated
exactly by its propagator exp(A h): torques and loads f are held over a step, that is, they are states of rate zero.
Where the hub's rate crosses zero, the hub sticks if the torque that holds it,

    needed = tau + c^T a / c^T b

does not exceed the static level; it breaks away where that torque exceeds it. Both instants are roots along the exact
solution.

Forces that vary with state or time (`modal_forces`) are held over steps of at most 1 ms at their value in the middle of
the step, to which a half step with the initial values leads (midpoint rule): the method is of second order, also in the
instants of stick and slip.
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
"""Number of bending modes: up to 42 Hz on `bossi2009`."""
_LONGEST_UNCHECKED = 1e-3
"""Longest time between two checks for stick and slip [s]: 1/20 of the third mode's period."""
_SHORT = 1e-9  # s, shortest step, so that an event is not found twice


class ModalPlant:
    """The modes of a rig with its friction.

    The state is z = [q, q_t, delivered torque, command, other hub torques, loads], of sizes n, n, 1, 1, 1, n or 0.
    """

    name = "modal"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = DEFAULT_MODES) -> None:
        """Prepares the modes of a model.

        Args:
          model: rig and effects, except backlash: its flanks are too stiff for forces held over a step.
          period: sample period [s].
          modes: number of bending modes.

        Raises:
          InputError: the model has backlash.
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
        self._longest_step = min(_LONGEST_UNCHECKED, model.step)
        self._along = np.linspace(0.0, model.rig["length"], 25)
        self._bends = rig.link(self._along) - np.outer(self._hub, self._along)
        self.reset()

    def reset(self, hub_angle: float = 0.0) -> None:
        """Resets the rig to rest at a hub angle [rad], time 0."""
        self._drive.reset()
        self._time = self._now = 0.0
        self._mode = 0
        self._z = np.zeros(len(self._needed))
        self._z[: self._size] = self._forces.gravity_equilibrium(hub_angle)
        self._z[self._delivered : self._other] = self._drive.torque
        self._set_forces(self._z, self._now)

    def advance(self, torque: float) -> None:
        """Advances by one period under a commanded torque [N m]."""
        self._drive.command(self._time, torque)
        for piece, span in self._drive.constant_spans(self._time, self.period):
            self._z[self._command] = piece
            count = int(np.ceil(span / self._longest_step - 1e-9))
            for _ in range(count):
                self._move(span / count)
        self._time += self.period
        self._now = self._time

    def time(self) -> float:
        """Time since the reset [s]."""
        return self._time

    def read(self) -> dict[str, float]:
        """Returns the present true value of each channel, SI."""
        q = self._z[: self._size]
        values = {name: float(row @ q) for name, row in self._outputs.items()}
        return {**values, "motor_torque": self._motor_torque(self._z)}

    @property
    def twist(self) -> float:
        """Angle of a torsional mode relative to the hub [rad]."""
        return float(self._twist @ self._z[: self._size])

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction in which it slides."""
        return self._mode

    @property
    def configuration(self) -> np.ndarray:
        """Coordinates q: alpha [rad], modal amplitudes [kg^1/2 m], angles that effects append [rad]."""
        return self._z[: self._size].copy()

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """Returns 25 points along the link (m, 25, 2) [m], hub axis first."""
        theta, bend = configurations @ self._hub, configurations @ self._bends
        cos, sin = np.cos(theta)[:, None], np.sin(theta)[:, None]
        return np.stack([cos * self._along - sin * bend, sin * self._along + cos * bend], axis=-1)

    # Stick and slip

    def _move(self, span: float) -> None:
        """Integrates over `span` [s], with every stick and slip in it."""
        if self._mode == 0:
            self._break_away()
        left = span
        while left > _SHORT:
            end = self._state_after(left, keep=left == span)
            if self._mode_margin(end) >= 0:
                self._z = end
                self._now += left
                return
            left -= self._move_to_event(left)

    def _move_to_event(self, span: float) -> float:
        """Integrates to the end of the present mode, within `span` [s], and switches it; returns the time taken [s]."""

        def margin(h: float) -> float:
            return self._mode_margin(self._state_after(h))

        when = brentq(margin, _SHORT, span, xtol=1e-12) if margin(_SHORT) > 0 else _SHORT
        self._z = self._state_after(when)
        self._now += when
        if self._mode == 0:
            self._slide(1 if self._holding_torque() > 0 else -1)
        else:
            self._halt()
        return when

    def _state_after(self, h: float, keep: bool = False) -> np.ndarray:
        """Returns the state after h [s] in the present mode; `keep` caches the propagator."""
        if not self._forces.vary:
            return self._propagator(h, keep) @ self._z
        half = self._set_forces(self._propagator(h / 2, keep) @ self._z, self._now + h / 2)
        middle = np.r_[self._z[: self._other], half[self._other :]]
        return self._set_forces(self._propagator(h, keep) @ middle, self._now + h)

    def _set_forces(self, z: np.ndarray, time: float) -> np.ndarray:
        """Sets the forces in a state z to their values at that state, a time [s], and the present mode; returns z."""
        q, rates = z[: self._size], z[self._size : 2 * self._size]
        z[self._other] = self._forces.on_hub(time, q, rates, self._mode)
        if self._forces.loads:
            z[self._other + 1 :] = self._forces.along_link(time, q, rates)
        return z

    def _mode_margin(self, z: np.ndarray) -> float:
        """Margin in z to the end of the mode: rate [rad/s] of a sliding hub, or unused static friction [N m]."""
        if self._mode != 0:
            return self._mode * float(self._hub @ z[self._size : 2 * self._size])
        return self._stiction_margin(z)

    def _stiction_margin(self, z: np.ndarray) -> float:
        """Static friction level less the torque that holds the hub at rest in z [N m]; negative: it breaks away."""
        needed = float(self._needed @ z)
        return self._forces.static(z[: self._size], 1 if needed > 0 else -1) - abs(needed)

    def _break_away(self) -> None:
        if self._mode_margin(self._z) < 0:
            self._slide(1 if self._holding_torque() > 0 else -1)

    def _halt(self) -> None:
        """Ends a slide at zero rate: the hub sticks, or slides in the direction of the torque."""
        self._mode = 0
        self._set_forces(self._z, self._now)
        if self._stiction_margin(self._z) < 0:
            self._slide(1 if self._holding_torque() > 0 else -1)
            return
        rates = self._z[self._size : 2 * self._size]
        # An impulse on the hub removes its remaining rate.
        rates -= self._push * (self._hub @ rates) / (self._hub @ self._push)

    def _slide(self, direction: int) -> None:
        self._mode = direction
        self._set_forces(self._z, self._now)

    def _holding_torque(self) -> float:
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
    """Returns A of the sliding and of the resting hub, and the row from z to the torque that holds it; sizes of z."""
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
    """Raises InputError for a model with backlash."""
    if model.plant.motor.gap > 0:
        raise InputError(f"effect backlash has no place in the {plant} plant; expected --plant chain for it")
