"""The chain linearised about rest at a hub angle, its hub sliding without dry friction.

    M phi_tt + D phi_t + K phi = e_hub tau

phi are the absolute angles of all coordinates less those of the equilibrium, with every coordinate that an effect adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.control.plants.base import READINGS
from twin.effects import REGISTRY, TORSION
from twin.mechanics.hub_law import HubTorque, LinearTorque
from twin.rigs.drive_law import drive_law
from twin.rigs.model import Model
from twin.rigs.simulate import gravity_equilibrium

LINK_READINGS = READINGS[:-1]
"""Readings without the motor torque."""
TRUE_VALUES = (*LINK_READINGS, TORSION, READINGS[-1])
"""What the sensors read: rows of the linearised chain, and the motor torque."""
_STEP = 1e-6  # SI, of finite differences


@dataclass(frozen=True)
class LinearisedChain:
    """The matrices, and what is measured of the motion.

    Attributes:
      mass, damping, stiffness: (n, n).
      rows, rate_rows: (5, n) from angles and from rates to hub angle, tip deflection, two strains and torsion angle.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    rows: np.ndarray
    rate_rows: np.ndarray

    def first_order(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns A (2n, 2n), B (2n, 1) and C (5, 2n): states are angles and rates, the input the delivered torque."""
        n = len(self.mass)
        inverse = np.linalg.inv(self.mass)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ self.stiffness, -inverse @ self.damping]])
        B = np.r_[np.zeros(n), inverse[:, 0]][:, None]
        return A, B, np.hstack([self.rows, self.rate_rows])


def has_linear_form(name: str, p: Mapping[str, float]) -> bool:
    """Whether an effect has a linear form that is the same at every hub angle."""
    torque = REGISTRY[name].hub_torque(p)
    return can_be_linearised(name, p) and (torque is None or torque.linear_part is not None)


def can_be_linearised(name: str, p: Mapping[str, float]) -> bool:
    """Whether an effect has a linear form at a hub angle."""
    return REGISTRY[name].linearisable and drive_law({name: p}).linear


def hub_slopes(model: Model) -> list[LinearTorque]:
    """Stiffness and damping of the effects whose torque on the hub is linear in angle and rate."""
    return [torque.linear_part for torque in model.hub_torques if torque.linear_part is not None]


def _slope_at(torque: HubTorque, hub_angle: float) -> LinearTorque:
    """Torque, stiffness and damping of a torque on the hub at rest at an angle [rad], at time 0."""
    below, above = (torque.at(0.0, hub_angle + side * _STEP, 0.0) for side in (-1, 1))
    back, ahead = (torque.at(0.0, hub_angle, side * _STEP) for side in (-1, 1))
    constant = torque.at(0.0, hub_angle, 0.0)
    return LinearTorque(constant, (below - above) / (2 * _STEP), (back - ahead) / (2 * _STEP))


def equilibrium(model: Model, hub_angle: float) -> np.ndarray:
    """Returns the absolute angles (n) [rad] of all coordinates at rest at a hub angle [rad]."""
    bends = gravity_equilibrium(model, hub_angle)
    return model.plant.extend_state(hub_angle + np.r_[0.0, np.cumsum(bends)])


def holding_torque(model: Model, hub_angle: float) -> float:
    """Returns the delivered torque [N m] that holds the rig at rest at a hub angle [rad], without dry friction."""
    link, angles = model.plant.link, equilibrium(model, hub_angle)
    gravity = link.first_moment @ (link.gravity_y * np.cos(angles) - link.gravity_x * np.sin(angles))
    return -float(gravity) - sum(_slope_at(torque, hub_angle).constant for torque in model.hub_torques)


def linearised_at(model: Model, hub_angle: float) -> LinearisedChain:
    """Returns the chain linearised about rest at a hub angle [rad]; torques on the hub by their slopes there."""
    slopes = [_slope_at(torque, hub_angle) for torque in model.hub_torques]
    return _linearised(model, equilibrium(model, hub_angle), slopes)


def linearised(model: Model) -> LinearisedChain:
    """Returns the chain linearised about the straight link along x, with the torques on the hub that are linear."""
    return _linearised(model, np.zeros(len(model.plant.link.lengths)), hub_slopes(model))


def _linearised(model: Model, angles: np.ndarray, slopes: list[LinearTorque]) -> LinearisedChain:
    link, links = model.plant.link, len(model.chain.lengths)
    n = len(link.lengths)
    relative = np.cos(angles[:, None] - angles)
    hinge = np.diff(np.eye(n)[:links], axis=0)
    K = hinge.T @ (link.stiffness[:, None] * hinge)
    D = hinge.T @ link.damping @ hinge
    twist = np.zeros(n)
    if link.torsion_stiffness > 0:
        twist[[0, links]] = -1.0, 1.0
        K += link.torsion_stiffness * np.outer(twist, twist)
        D += link.torsion_damping * np.outer(twist, twist)
    for slope in slopes:
        K[0, 0] += slope.stiffness
        D[0, 0] += slope.damping
    D += link.drag_linear * np.outer(link.lengths, link.lengths) * relative
    K += np.diag(link.first_moment * (link.gravity_x * np.cos(angles) + link.gravity_y * np.sin(angles)))
    rows, rate_rows = _output_rows(model, link.lengths * relative[0], hinge, twist)
    return LinearisedChain(link.inertia * relative, D, K, rows, rate_rows)


def _output_rows(
    model: Model, across: np.ndarray, hinge: np.ndarray, twist: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (5, n) on angles and on rates; `across` (n) [m] is how far an angle of each segment moves the tip."""
    hub = np.eye(len(across))[0]
    rows, rate_rows = np.zeros((2, len(LINK_READINGS) + 1, len(across)))
    rows[0], rows[1], rows[-1] = hub, across - across.sum() * hub, twist
    for place, name in enumerate(LINK_READINGS[2:], 2):
        rows[place] = model.strain_rows[name] @ hinge
        if name in model.curvature_rate_rows:
            rate_rows[place] = model.sensors[name].half_thickness * model.curvature_rate_rows[name] @ hinge
    return rows, rate_rows


def sensor_model(model: Model, at: Mapping[str, float] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Gain (5, 6) of each reading on each true value, and delay (5) of each reading [s], by finite differences.

    The delay is that of the response to a ramp.

    Args:
      model: rig and effects.
      at: true values about which; 0 where none is given.
    """
    time = np.linspace(0.0, 0.2, 101)
    about = {name: np.full(len(time), (at or {}).get(name, 0.0)) for name in TRUE_VALUES}

    def read(changed: dict[str, np.ndarray]) -> np.ndarray:
        readings = model.report(time, {**about, **{name: about[name] + v for name, v in changed.items()}})
        return np.array([readings[name][-1] for name in READINGS])

    rest = read({})
    slopes = np.stack([read({name: np.full(len(time), _STEP)}) - rest for name in TRUE_VALUES], axis=1)
    slopes = slopes / _STEP
    ramps = np.array([(read({name: _STEP * time}) - rest)[i] for i, name in enumerate(READINGS)]) / _STEP
    own = np.array([slopes[i, TRUE_VALUES.index(name)] for i, name in enumerate(READINGS)])
    return slopes, np.maximum(time[-1] - ramps / own, 0.0).round(9)


def drive_model(model: Model) -> tuple[float, float, float]:
    """Gain [1], delay [s] and lag [s] that the effects give the drive."""
    law = drive_law(model.effects)
    return law.gain, law.delay, max(model.plant.motor.lag, law.lag)
