"""One compiled MuJoCo model of the chain, its hub free to turn or locked, stepped with what MuJoCo lacks."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from twin.mechanics import mjcf, planar
from twin.mechanics.chain import Chain
from twin.mechanics.hub_law import HubTorque
from twin.mechanics.plant import CONTACT_STIFFNESS, Plant

_OFF = mujoco.mjtDisableBit
_DISABLED = int(_OFF.mjDSBL_CONSTRAINT | _OFF.mjDSBL_CONTACT | _OFF.mjDSBL_SENSOR | _OFF.mjDSBL_AUTORESET)


class ChainModel:
    """A compiled model, its data and one saved state."""

    def __init__(
        self,
        rig: Mapping[str, float],
        chain: Chain,
        plant: Plant,
        torques: Sequence[HubTorque],
        locked: bool,
    ) -> None:
        spec = mjcf.dynamics_spec(chain, plant, rig, torques, locked, compact=True)
        self.varying = [t for t in torques if t.linear is None and not (t.write and t.exact)]
        if plant.link.drag_quadratic != 0 and plant.link.drag_linear == 0:
            mjcf.add_tip_drag(spec, 0.0)
        self._waves = plant.friction.amplitude != 0 and not locked
        if self._waves:
            mjcf.add_sinusoid(spec, "hub", "friction", 0.0, plant.friction.order, plant.friction.phase)
        self.model = spec.compile()
        self.model.opt.disableflags = _DISABLED
        self.data, self._options = mujoco.MjData(self.model), self.model.opt
        self.qpos, self.qvel, self._applied = self.data.qpos, self.data.qvel, self.data.qfrc_applied
        self._saved = self.qpos.copy(), self.qvel.copy()
        self._plant, self._curvature = plant, plant.link.curvature_per_angle
        self._wave = self.model.actuator("friction").id if self._waves else -1
        self._drag = self.model.actuator("drag_x").id if plant.link.drag_quadratic != 0 else -1
        self._gravity = complex(plant.link.gravity_x, plant.link.gravity_y)
        self._held, self._drive, self._mode, self.needed = 0.0, 0.0, 0, 0.0
        self._angle = 0.0  # of a locked hub
        self._first = 0 if locked else 1

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Sets joint angles [rad] and rates [rad/s]."""
        self.qpos[:], self.qvel[:] = qpos, qvel

    def turn(self, theta: float) -> None:
        """Locks the hub at an angle [rad]: in the hub's frame, gravity turns the other way."""
        self._angle = theta
        seen = self._gravity * cmath.exp(-1j * theta)
        self.model.opt.gravity[:2] = seen.real, seen.imag

    def save(self) -> None:
        """Remembers the state."""
        self._saved[0][:], self._saved[1][:] = self.qpos, self.qvel

    def restore(self) -> None:
        """Returns to the remembered state."""
        self.qpos[:], self.qvel[:] = self._saved

    def step(self, time: float, h: float, steps: int = 1) -> None:
        """Moves on from `time` by steps of `h` [s]."""
        self._options.timestep, self.data.time = h, time
        mujoco.mj_step(self.model, self.data, steps)

    def push(self, torque: float, mode: int) -> None:
        """Applies a torque [N m] and the friction of a hub that slides in direction `mode`; 0: none."""
        p = self._plant
        raised = p.friction.amplitude / 2
        _, level = p.friction.levels(mode)
        self._held, self._drive, self._mode = -mode * (level + raised), torque, mode
        self._apply(self._held, torque)
        if self._waves:
            self.model.actuator_biasprm[self._wave, 0] = -mode * raised

    def _apply(self, on_hub: float, drive: float) -> None:
        """Applies torques [N m] to the hub, if it can turn, and to what the motor turns."""
        if self._plant.motor.gap > 0:
            self._applied[-1] = drive
        else:
            on_hub += drive
        if self._first:
            self._applied[0] = on_hub

    def torque_to_hold(self, time: float) -> float:
        """Torque against the hub [N m] that would take its acceleration away."""
        self.data.time = time
        mujoco.mj_forward(self.model, self.data)
        # M = L^T D L with the hub first: (M^-1)_00 = 1 / D_0, one over the hub's articulated inertia.
        self.needed = float(self.data.qacc[0] / self.data.qLDiagInv[0])
        return self.needed

    # Mechanisms that the models do not have, at the state of a stage

    def vary_torque(self, time: float, lagging: float) -> None:
        """Adds what the lag keeps back [N m], laws that MuJoCo lacks, Stribeck's excess and the contact in a play."""
        p, torque, drive = self._plant, self._held, self._drive + lagging
        for law in self.varying:
            if law.on_motor and p.motor.gap > 0:
                drive += law.at(time - p.torques.since, self.qpos[-1], self.qvel[-1])
            else:
                torque += law.at(time - p.torques.since, *self._of_hub())
        if p.friction.stribeck_velocity > 0 and self._mode != 0:
            static, coulomb = p.friction.levels(self._mode)
            excess = static - coulomb
            torque -= self._mode * excess * math.exp(-((self.qvel[0] / p.friction.stribeck_velocity) ** 2))
        if p.motor.gap > 0:
            contact = self._contact()
            torque, drive = torque + contact, drive - contact
        self._apply(torque, drive)

    def _contact(self) -> float:
        """Torque [N m] from the motor to the hub, as `planar.contact_torque`."""
        angle, rate = self._of_hub()
        play = self.qpos[-1] - angle
        beyond = abs(play) - self._plant.motor.gap / 2
        if beyond <= 0:
            return 0.0
        pressing = math.copysign(1.0, play) * (self.qvel[-1] - rate)
        push = CONTACT_STIFFNESS * beyond + planar.contact_damping(self._plant) * pressing
        return math.copysign(max(push, 0.0), play)

    def _of_hub(self) -> tuple[float, float]:
        """Angle [rad] and rate [rad/s] of the hub."""
        return (self.qpos[0], self.qvel[0]) if self._first else (self._angle, 0.0)

    def shake(self, time: float) -> None:
        """Pushes every mass back as the base is accelerated; a locked hub sees it turned the other way."""
        p = self._plant
        wave = math.sin(2 * math.pi * p.link.shake_frequency * time + p.link.shake_phase)
        field = -wave * complex(p.link.shake_x, p.link.shake_y) * cmath.exp(-1j * self._angle)
        self.data.xfrc_applied[:, 0] = field.real * self.model.body_mass
        self.data.xfrc_applied[:, 1] = field.imag * self.model.body_mass

    def soften(self) -> None:
        """Takes away what a hinge's moment lacks: k q s kappa^2 / (kappa^2 + kappa_0^2)."""
        p, bends = self._plant, len(self._plant.link.stiffness)
        hinges = slice(self._first, self._first + bends)
        angle = self.qpos[hinges]
        squared = (self._curvature * angle) ** 2
        share = p.link.softening * squared / (squared + p.link.softening_curvature**2)
        self._applied[hinges] = p.link.stiffness * angle * share

    def drag_tip(self) -> None:
        """Force -c |v| v on the payload, v as the drag's transmission sees it."""
        pair = slice(self._drag, self._drag + 2)
        vx, vy = self.data.actuator_velocity[pair]
        factor = -self._plant.link.drag_quadratic * math.hypot(vx, vy)
        self.data.ctrl[pair] = factor * vx, factor * vy
