"""Sampled linear model of a rig at small amplitude, with a hub that slides without dry friction.

It is either the modal model with a number of bending modes (Bossi et al. 2009, section III), or the chain linearised
about the straight link, M phi_tt + D phi_t + K phi = e_hub tau, with every coordinate that an effect adds. The torque
is held over a sample. Gain, delay and lag of the drive, and gains and delays of the sensors, are those of the effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from twin.control.plants.base import READINGS
from twin.effects import REGISTRY, TORSION
from twin.mechanics.hub_law import LinearTorque
from twin.mechanics.modal import state_space
from twin.recording import GAUGES
from twin.rigs.drive_law import drive_law
from twin.rigs.model import Model

_LINK_READINGS = READINGS[:-1]
"""Readings without the motor torque."""
_STEP = 1e-6  # SI, of the finite differences of the sensor model


@dataclass(frozen=True)
class SampledSystem:
    """x+ = A x + B u, y = C x with a torque u held over a sample [N m].

    Attributes:
      A: (k, k).
      B: (k, 1).
      C: (5, k), readings in the order of `READINGS`.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray


def sampled_modes(model: Model, period: float, modes: int) -> SampledSystem:
    """Returns the modal model of a rig, with effects on drive, sensors, hub and rig parameters.

    Args:
      model: rig and effects.
      period: sample period [s].
      modes: bending modes.
    """
    system = state_space(model.rig, modes, GAUGES)
    A, B, C = (np.array(m, dtype=float) for m in (system.A, system.B, system.C))
    size = modes + 1
    hub, push = C[0, :size], B[size:, 0]
    for slope in _hub_slopes(model):
        A[size:, :size] -= slope.stiffness * np.outer(push, hub)
        A[size:, size:] -= slope.damping * np.outer(push, hub)
    # The row of the torsion angle is zero: torsion is no bending mode.
    return _with_sensors(
        model, _zero_order_hold(A, B, np.vstack([C, 0 * C[:1]]), _drive_model(model), period), period
    )


def sampled_chain(model: Model, period: float) -> tuple[SampledSystem, tuple[str, ...]]:
    """Returns the linearised chain of a rig, and the names of effects without linear form, which are left out.

    Args:
      model: rig and effects.
      period: sample period [s].
    """
    left_out = tuple(name for name, p in model.effects.items() if not _is_linearisable(name, p))
    model = model.replace(effects={name: p for name, p in model.effects.items() if name not in left_out})
    M, D, K, rows, rate_rows = _linearised_chain(model)
    n = len(M)
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ D]])
    B = np.r_[np.zeros(n), inverse[:, 0]][:, None]
    rig = _zero_order_hold(A, B, np.hstack([rows, rate_rows]), _drive_model(model), period)
    return _with_sensors(model, rig, period), left_out


def _is_linearisable(name: str, p: Mapping[str, float]) -> bool:
    """Whether an effect has a linear form about rest."""
    effect = REGISTRY[name]
    torque = effect.hub_torque(p)
    return (
        effect.linearisable
        and drive_law({name: p}).linear
        and (torque is None or torque.linear_part is not None)
    )


def _hub_slopes(model: Model) -> list[LinearTorque]:
    """Stiffness and damping of the effects whose torque on the hub is linear in angle and rate."""
    return [torque.linear_part for torque in model.hub_torques if torque.linear_part is not None]


def _linearised_chain(model: Model) -> tuple[np.ndarray, ...]:
    """M, D, K (n, n) about the straight link along x, and output rows (5, n) on angles and on rates.

    The outputs are hub angle, tip deflection, two strains and the torsion angle.
    """
    plant, links = model.plant, len(model.chain.lengths)
    n = len(plant.link.lengths)
    hinge = np.diff(np.eye(n)[:links], axis=0)
    K = hinge.T @ (plant.link.stiffness[:, None] * hinge)
    D = hinge.T @ plant.link.damping @ hinge
    twist = np.zeros(n)
    if plant.link.torsion_stiffness > 0:
        twist[[0, links]] = -1.0, 1.0
        K += plant.link.torsion_stiffness * np.outer(twist, twist)
        D += plant.link.torsion_damping * np.outer(twist, twist)
    for slope in _hub_slopes(model):
        K[0, 0] += slope.stiffness
        D[0, 0] += slope.damping
    D += plant.link.drag_linear * np.outer(plant.link.lengths, plant.link.lengths)
    K += plant.link.gravity_x * np.diag(plant.link.first_moment)
    hub = np.eye(n)[0]
    tip = plant.link.lengths - plant.link.lengths.sum() * hub
    rows, rate_rows = np.zeros((2, len(_LINK_READINGS) + 1, n))
    rows[0], rows[1], rows[-1] = hub, tip, twist
    for place, name in enumerate(_LINK_READINGS[2:], 2):
        thickness = model.sensors[name].half_thickness
        rows[place] = thickness * model.curvature_rows[name] @ hinge
        if name in model.curvature_rate_rows:
            rate_rows[place] = thickness * model.curvature_rate_rows[name] @ hinge
    return plant.link.inertia, D, K, rows, rate_rows


def _with_sensors(model: Model, rig: SampledSystem, period: float) -> SampledSystem:
    """Adds the sensors: hub angle, tip, strains, torsion and motor torque (6) -> readings (5) with their delays."""
    slopes, delays = _sensor_model(model)
    return _with_output_delays(SampledSystem(rig.A, rig.B, slopes @ rig.C), delays / period)


def _sensor_model(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Gain (5, 6) of each reading on each true value at zero, and delay (5) of each reading [s], by finite differences.

    The delay is that of the response to a ramp.
    """
    names = (*_LINK_READINGS, TORSION, READINGS[-1])
    time = np.linspace(0.0, 0.2, 101)

    def read(values: dict[str, np.ndarray]) -> np.ndarray:
        readings = model.report(time, {name: values.get(name, np.zeros(len(time))) for name in names})
        return np.array([readings[name][-1] for name in READINGS])

    rest = read({})
    slopes = np.stack([read({name: np.full(len(time), _STEP)}) - rest for name in names], axis=1) / _STEP
    ramps = np.array([(read({name: _STEP * time}) - rest)[i] for i, name in enumerate(READINGS)]) / _STEP
    own = np.array([slopes[i, names.index(name)] for i, name in enumerate(READINGS)])
    return slopes, np.maximum(time[-1] - ramps / own, 0.0).round(9)


def _with_output_delays(rig: SampledSystem, samples: np.ndarray) -> SampledSystem:
    """Delays each output by a number of samples (5), with linear interpolation between samples."""
    whole = np.floor(samples + 1e-6).astype(int)
    depth, n, count = int(whole.max()) + 1, len(rig.A), len(rig.C)
    if not samples.any():
        return rig
    # The state is augmented by past readings, the newest first.
    size = n + depth * count
    A, B = np.zeros((size, size)), np.vstack([rig.B, np.zeros((depth * count, 1))])
    A[:n, :n], A[n : n + count, :n] = rig.A, rig.C
    A[n + count :, n : size - count] = np.eye(size - n - count)
    past = [np.hstack([rig.C, np.zeros((count, size - n))])]
    past += [np.eye(size)[n + k * count : n + (k + 1) * count] for k in range(depth)]
    C = np.empty((count, size))
    for i, (k, late) in enumerate(zip(whole, samples, strict=True)):
        share = max(late - k, 0.0)
        C[i] = (1 - share) * past[k][i] + share * past[k + 1][i]
    return SampledSystem(A, B, C)


def _zero_order_hold(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, drive: tuple[float, float, float], period: float
) -> SampledSystem:
    """Discretises a rig with its drive by zero-order hold.

    The state is that of the link, the delivered torque if the drive has a lag, and the last commands.

    Args:
      A, B, C: in continuous time, from delivered torque to true values.
      drive: gain [1], delay [s] and lag [s].
      period: sample period [s].
    """
    gain, delay, lag = drive
    whole = int(delay / period + 1e-9)
    fraction = max(delay - whole * period, 0.0)
    dynamic, n = len(A) + (lag > 0), len(A)
    inner = np.zeros((dynamic + 1, dynamic + 1))
    inner[:n, :n] = A
    inner[:n, n] = B[:, 0] * (1.0 if lag > 0 else gain)
    if lag > 0:
        inner[n, n:] = -1 / lag, gain / lag
    first, second = expm(inner * fraction), expm(inner * (period - fraction))
    # Within a sample the command of whole + 1 samples ago acts first, then the one after it.
    states = np.zeros((dynamic + whole + 1,) * 2)
    push = np.zeros((len(states), 1))
    states[:dynamic, :dynamic] = second[:dynamic, :dynamic] @ first[:dynamic, :dynamic]
    states[:dynamic, -1] = second[:dynamic, :dynamic] @ first[:dynamic, dynamic]
    if whole:
        states[:dynamic, -2] += second[:dynamic, dynamic]
    else:
        push[:dynamic, 0] = second[:dynamic, dynamic]
    # Commands on their way, the newest first.
    push[dynamic, 0] = 1.0
    states[dynamic + 1 :, dynamic:-1] = np.eye(whole)
    read = np.zeros((len(C) + 1, len(states)))
    read[:-1, :n] = C
    read[-1, n if lag > 0 else -1] = 1.0 if lag > 0 else gain
    return SampledSystem(states, push, read)


def _drive_model(model: Model) -> tuple[float, float, float]:
    """Gain [1], delay [s] and lag [s] that the effects give the drive."""
    law = drive_law(model.effects)
    return law.gain, law.delay, max(model.plant.motor.lag, law.lag)
