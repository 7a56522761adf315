"""The linear rig of the modal plant, in the modes of the rig as built and what effects add to them.

    M q_tt + D q_t + K q = forces        q = [alpha, delta_1..n, angles that effects add]

Without effects these are the modes of `twin.mechanics.modal`, M = diag(J, 1, ...). An effect adds an angle p of its
own, with which a part I of the hub's inertia moves otherwise than the hub of the modes, of rate theta_t = c^T q_t:

    clamp that gives    the hub, all of it, is behind its link by p     1/2 I (theta_t - p_t)^2 for 1/2 I theta_t^2
    torsional mode      an oscillator is ahead of the hub by p          1/2 I (theta_t + p_t)^2 for 1/2 I theta_t^2

M gets the row [-+ I c, I], K and D its spring and damper. So the modes of the rigid clamp, three or so, stand for all
that the link bends: a Ritz basis, whose frequencies are a little high.
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
    """Its matrices and what is read off its n coordinates.

    Attributes:
      mass, damping, stiffness: (n, n).
      outputs: (n) per channel.
      modes: bending modes; their amplitudes are the coordinates from 1 on.
      twist: (n) from the coordinates to the angle of a torsional mode against the hub.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    outputs: dict[str, np.ndarray]
    modes: Modes
    twist: np.ndarray

    @property
    def hub(self) -> np.ndarray:
        """Angle of the hub per coordinate (n)."""
        return self.outputs["hub_angle"]

    @property
    def tip(self) -> np.ndarray:
        """Way of the tip across the link per coordinate (n)."""
        return self.outputs["tip_deflection"] + self.modes.length * self.hub

    def link(self, x: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Way of the link across itself at x (k) [m], its slope or its curvature, per coordinate (n, k)."""
        rigid = (x, np.ones(len(x)), np.zeros(len(x)))[derivative]
        rows = np.vstack([rigid, self.modes.shape(x, derivative)])
        return np.pad(rows, ((0, len(self.mass) - len(rows)), (0, 0)))


def modal_rig(model: Model, count: int) -> ModalRig:
    """Returns the linear rig of a model with `count` bending modes; friction and cable of the hub are not in it."""
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
    """A rig whose clamp gives."""
    stiffness = model.chain.root_stiffness
    if stiffness == math.inf:
        return rig
    return _with_angle(
        rig, -model.rig["hub_inertia"], stiffness, 0.0, hub_angle=-1.0, tip_deflection=rig.modes.length
    )


def _with_torsion(rig: ModalRig, model: Model) -> ModalRig:
    """A rig with an oscillator on its hub."""
    plant, place = model.plant, len(model.chain.lengths)
    if plant.link.torsion_stiffness <= 0:
        return rig
    more = _with_angle(
        rig, plant.link.inertia[place, place], plant.link.torsion_stiffness, plant.link.torsion_damping
    )
    return replace(more, twist=np.eye(len(more.mass))[-1])


def _with_angle(rig: ModalRig, inertia: float, stiffness: float, damping: float, **seen: float) -> ModalRig:
    """A rig with one more angle.

    Args:
      rig: the rig.
      inertia: that moves by this angle ahead of the hub [kg m^2]; negative for one that it is behind by it.
      stiffness, damping: of the angle [N m/rad], [N m s/rad].
      seen: by how much the angle changes each reading.
    """
    row = inertia * rig.hub[:, None]
    return ModalRig(
        np.block([[rig.mass, row], [row.T, np.array([[abs(inertia)]])]]),
        block_diag(rig.damping, [[damping]]),
        block_diag(rig.stiffness, [[stiffness]]),
        {name: np.append(row, seen.get(name, 0.0)) for name, row in rig.outputs.items()},
        rig.modes,
        np.append(rig.twist, 0.0),
    )
