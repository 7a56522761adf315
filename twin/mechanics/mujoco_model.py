"""One compiled MuJoCo model of the chain, hub free to turn or locked, and the forces that MuJoCo has no element for.

`MujocoChain` steps two of these and decides which one; the forces are computed in its control callback.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from typing import Literal

import mujoco
import numpy as np

from twin.mechanics import mjcf, planar
from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import HubTorque
from twin.mechanics.plant import Plant

_OFF = mujoco.mjtDisableBit
_DISABLED = int(_OFF.mjDSBL_CONSTRAINT | _OFF.mjDSBL_CONTACT | _OFF.mjDSBL_SENSOR | _OFF.mjDSBL_AUTORESET)


class ChainModel:
    """A compiled model, its data, and one saved state; `varying` are hub laws without an exact MuJoCo element."""

    def __init__(
        self,
        rig: Mapping[str, float],
        chain: Chain,
        plant: Plant,
        torques: Sequence[HubTorque],
        locked: Literal["", "hub", "rotor"],
    ) -> None:
        """Compiles the model; arguments are those of `mjcf.dynamics_spec`."""
        spec = mjcf.dynamics_spec(chain, plant, rig, torques, locked, compact=True)
        self.varying = [t for t in torques if t.linear is None and not (t.write and t.exact)]
        if plant.link.drag_quadratic != 0 and plant.link.drag_linear == 0:
            mjcf.add_tip_drag(spec, 0.0)
        self._waves = plant.friction.amplitude != 0 and not locked
        if self._waves:
            joint, friction = mjcf.friction_joint(plant), plant.friction
            mjcf.add_sinusoid(spec, joint, "friction", 0.0, friction.order, friction.phase)
        self.model = spec.compile()
        self.model.opt.disableflags = _DISABLED
        self.data, self._options = mujoco.MjData(self.model), self.model.opt
        self.qpos, self.qvel, self._applied = self.data.qpos, self.data.qvel, self.data.qfrc_applied
        self._acceleration, self._inverse_inertia = self.data.qacc, self.data.qLDiagInv
        self._saved = self.qpos.copy(), self.qvel.copy()
        self._plant, self._curvature = plant, plant.link.curvature_per_angle
        self._wave = self.model.actuator("friction").id if self._waves else -1
        self._drag = self.model.actuator("drag_x").id if plant.link.drag_quadratic != 0 else -1
        self._gravity = complex(plant.link.gravity_x, plant.link.gravity_y)
        # Torques held over a step: on the hub, from the motor [N m]; mode; and the torque of `torque_to_hold`.
        self._held, self._drive, self._mode, self.needed = 0.0, 0.0, 0, 0.0
        self._given = math.nan, 0  # torque and mode that were applied last
        self._h = math.nan  # s, time step that was set last
        self._angle = self._motor = 0.0  # rad, of a locked hub, of a locked motor
        self._first = 0 if locked == "hub" else 1  # index of the first hinge among the joints
        self._has_rotor = plant.motor.gap > 0 and locked != "rotor"
        self.rubbing = -1 if plant.rubs_on_motor else 0
        """Index of the joint on which dry friction acts."""

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Sets joint angles [rad] and rates [rad/s]."""
        self.qpos[:], self.qvel[:] = qpos, qvel

    def lock_at(self, theta: float) -> None:
        """Sets the angle of a locked motor, or of a locked hub [rad].

        The model's locked hub is at zero angle, so that gravity is rotated back.
        """
        if self._first:
            self._motor = theta
            return
        self._angle = theta
        gravity = self._gravity * cmath.exp(-1j * theta)
        self.model.opt.gravity[:2] = gravity.real, gravity.imag

    def save(self) -> None:
        """Saves the state."""
        self._saved[0][:], self._saved[1][:] = self.qpos, self.qvel

    def restore(self) -> None:
        """Restores the saved state."""
        self.qpos[:], self.qvel[:] = self._saved

    def step(self, time: float, h: float, steps: int = 1) -> None:
        """Integrates from `time` by `steps` steps of `h` [s]."""
        if h != self._h:
            self._options.timestep = self._h = h
        self.data.time = time
        mujoco.mj_step(self.model, self.data, steps)

    def apply_torque(self, torque: float, mode: int) -> None:
        """Applies a motor torque [N m], and Coulomb friction against sliding in direction `mode`; 0: none."""
        if self._given == (torque, mode):
            return
        self._given = torque, mode
        p = self._plant
        raised = p.friction.amplitude / 2
        _, level = p.friction.levels(mode)
        friction = -mode * (level + raised)
        self._mode = mode
        self._held, self._drive = (0.0, torque + friction) if p.rubs_on_motor else (friction, torque)
        self._apply(self._held, self._drive)
        if self._waves:
            self.model.actuator_biasprm[self._wave, 0] = -mode * raised

    def _apply(self, on_hub: float, drive: float) -> None:
        """Applies a torque on the hub, if it can turn, and the motor's [N m], on its own joint if there is backlash."""
        if self._has_rotor:
            self._applied[-1] = drive
        elif self._plant.motor.gap <= 0:
            on_hub += drive
        if self._first:
            self._applied[0] = on_hub

    def torque_to_hold(self, time: float) -> float:
        """Returns the torque [N m] that, subtracted, would stop what dry friction acts on; keeps it in `needed`."""
        self.data.time = time
        mujoco.mj_forward(self.model, self.data)
        # M = L^T D L with the hub first: (M^-1)_00 = 1 / D_0, one over the hub's articulated inertia; a motor is alone.
        self.needed = float(self._acceleration[self.rubbing] / self._inverse_inertia[self.rubbing])
        return self.needed

    # Forces without a MuJoCo element, at the state of a stage of the integrator

    def apply_varying_torques(self, time: float, lagging: float) -> None:
        """Applies all torques that vary within a step: hub laws, Stribeck friction, contact torque of a backlash.

        Args:
          time: time [s].
          lagging: delivered motor torque less the command [N m].
        """
        p, torque, drive = self._plant, self._held, self._drive + lagging
        for law in self.varying:
            if law.on_motor and p.motor.gap > 0:
                drive += law.at(time - p.torques.since, *self._motor_state())
            else:
                torque += law.at(time - p.torques.since, *self._hub_state())
        if p.friction.stribeck_velocity > 0 and self._mode != 0:
            static, coulomb = p.friction.levels(self._mode)
            rate = self.qvel[self.rubbing] / p.friction.stribeck_velocity
            excess = self._mode * (static - coulomb) * math.exp(-(rate**2))
            torque, drive = (torque, drive - excess) if p.rubs_on_motor else (torque - excess, drive)
        if p.motor.gap > 0:
            contact = self._contact()
            torque, drive = torque + contact, drive - contact
        self._apply(torque, drive)

    def _contact(self) -> float:
        """Contact torque [N m] of the motor on the hub."""
        angle, rate = self._hub_state()
        motor, turning = self._motor_state()
        # Not the compiled function: to pass it a plant takes longer than the torque does.
        return float(planar.contact_torque.py_func(self._plant, motor - angle, turning - rate))

    def _hub_state(self) -> tuple[float, float]:
        """Angle [rad] and rate [rad/s] of the hub."""
        return (self.qpos[0], self.qvel[0]) if self._first else (self._angle, 0.0)

    def _motor_state(self) -> tuple[float, float]:
        """Angle [rad] and rate [rad/s] of the motor behind a backlash."""
        return (self.qpos[-1], self.qvel[-1]) if self._has_rotor else (self._motor, 0.0)

    def apply_base_acceleration(self, time: float) -> None:
        """Applies the inertial force of an accelerated base to every body, rotated back by a locked hub's angle."""
        p = self._plant
        wave = math.sin(2 * math.pi * p.link.shake_frequency * time + p.link.shake_phase)
        field = -wave * complex(p.link.shake_x, p.link.shake_y) * cmath.exp(-1j * self._angle)
        self.data.xfrc_applied[:, 0] = field.real * self.model.body_mass
        self.data.xfrc_applied[:, 1] = field.imag * self.model.body_mass

    def apply_softening(self) -> None:
        """Applies the missing part of the hinge moments, k q s kappa^2 / (kappa^2 + kappa_0^2)."""
        p, bends = self._plant, len(self._plant.link.stiffness)
        hinges = slice(self._first, self._first + bends)
        angle = self.qpos[hinges]
        self._applied[hinges] = p.link.stiffness * angle * p.link.softened_share(self._curvature * angle)

    def apply_tip_drag(self) -> None:
        """Applies the force -c |v| v on the payload, v being the velocity of the drag actuators' transmission."""
        pair = slice(self._drag, self._drag + 2)
        vx, vy = self.data.actuator_velocity[pair]
        factor = -self._plant.link.drag_quadratic * math.hypot(vx, vy)
        self.data.ctrl[pair] = factor * vx, factor * vy
