"""The linear part of the modal plant: modes of the rig without effects, and coordinates that effects append.

    M q_tt + D q_t + K q = forces        q = [alpha, delta_1..n, appended angles]

Without effects these are the modes of `twin.mechanics.modal`, M = diag(J, 1, ...). An effect may append an angle p by
which a part I of the hub's inertia moves relative to the hub of the modes, whose rate is theta_t = c^T q_t. Its kinetic
energy 1/2 I theta_t^2 is replaced:

    compliant clamp     the whole hub lags its link by p           1/2 I (theta_t - p_t)^2
    torsional mode      an oscillator leads the hub by p           1/2 I (theta_t + p_t)^2

M gets the row [-+ I c, I], K and D the spring and damper of p. The few modes of the rigid clamp are then a Ritz basis
for the bending of the link, which makes the frequencies slightly too high.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from twin.mechanics.beam import Modes, rigid_inertia
from twin.mechanics.beam import modes as beam_modes
from twin.mechanics.modal import state_space
from twin.recording import GAUGES
from twin.rigs.model import Model


@dataclass(frozen=True)
class ModalRig:
    """Matrices of the linear rig with n coordinates, and its outputs.

    Attributes:
      mass, damping, stiffness: (n, n) M, D, K.
      outputs: channel -> row (n) from coordinates to its true value, SI.
      modes: bending modes; their amplitudes are the coordinates from 1 on.
      twist: (n) row from coordinates to the angle of a torsional mode relative to the hub; 0 without one.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    outputs: dict[str, np.ndarray]
    modes: Modes
    twist: np.ndarray

    @property
    def hub(self) -> np.ndarray:
        """Row (n) from coordinates to the hub angle."""
        return self.outputs["hub_angle"]

    @property
    def tip(self) -> np.ndarray:
        """Row (n) from coordinates to the transverse displacement of the tip [m]."""
        return self.outputs["tip_deflection"] + self.modes.length * self.hub

    def link(self, x: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Returns the transverse displacement at x (k) [m], or slope or curvature, per coordinate (n, k)."""
        rigid = (x, np.ones(len(x)), np.zeros(len(x)))[derivative]
        rows = np.vstack([rigid, self.modes.shape(x, derivative)])
        return np.pad(rows, ((0, len(self.mass) - len(rows)), (0, 0)))


def modal_rig(model: Model, count: int) -> ModalRig:
    """Returns the linear rig of a model with `count` bending modes, without friction and torques on the hub."""
    gauges = [sensor for sensor in model.sensors.values() if sensor.half_thickness > 0]
    system = state_space(model.rig, count, gauges or GAUGES)
    size = count + 1
    inner = np.asarray(system.A)[size:]
    outputs = dict(zip(system.output_labels, np.asarray(system.C)[:, :size], strict=True))
    mass = np.diag(np.r_[rigid_inertia(model.rig), np.ones(count)])
    rig = ModalRig(
        mass,
        -inner[:, size:],
        -inner[:, :size],
        outputs,
        beam_modes(model.rig, count),
        np.zeros(size),
    )
    rig = _with_torsion(_with_root(rig, model), model)
    return replace(rig, damping=rig.damping + model.plant.link.drag_linear * np.outer(rig.tip, rig.tip))


def _with_root(rig: ModalRig, model: Model) -> ModalRig:
    """Returns a rig with the compliant clamp of a model, if it has one."""
    stiffness = model.chain.root_stiffness
    if stiffness == math.inf:
        return rig
    return _with_angle(
        rig, -model.rig["hub_inertia"], stiffness, 0.0, hub_angle=-1.0, tip_deflection=rig.modes.length
    )


def _with_torsion(rig: ModalRig, model: Model) -> ModalRig:
    """Returns a rig with the torsional mode of a model, if it has one."""
    plant, place = model.plant, len(model.chain.lengths)
    if plant.link.torsion_stiffness <= 0:
        return rig
    extended = _with_angle(
        rig, plant.link.inertia[place, place], plant.link.torsion_stiffness, plant.link.torsion_damping
    )
    return replace(extended, twist=np.eye(len(extended.mass))[-1])


def _with_angle(
    rig: ModalRig, inertia: float, stiffness: float, damping: float, **outputs: float
) -> ModalRig:
    """Returns a rig with one more angle.

    Args:
      rig: the rig.
      inertia: inertia that leads the hub by this angle [kg m^2]; negative if it lags the hub by it.
      stiffness, damping: of the angle [N m/rad], [N m s/rad].
      outputs: channel -> derivative of its true value with respect to the angle; 0 for others.
    """
    row = inertia * rig.hub[:, None]
    return ModalRig(
        np.block([[rig.mass, row], [row.T, np.array([[abs(inertia)]])]]),
        block_diag(rig.damping, [[damping]]),
        block_diag(rig.stiffness, [[stiffness]]),
        {name: np.append(row, outputs.get(name, 0.0)) for name, row in rig.outputs.items()},
        rig.modes,
        np.append(rig.twist, 0.0),
    )
