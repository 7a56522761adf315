"""Sampled linear model of a rig at small amplitude, with a hub that slides without dry friction.

It is either the modal model with a number of bending modes (Bossi et al. 2009, section III), or the chain linearised
about the straight link, M phi_tt + D phi_t + K phi = e_hub tau, with every coordinate that an effect adds. The torque
is held over a sample. Gain, delay and lag of the drive, and gains and delays of the sensors, are those of the effects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from twin.control.plants import linear_chain
from twin.mechanics.modal import state_space
from twin.recording import GAUGES
from twin.rigs.model import Model


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
    for slope in linear_chain.hub_slopes(model):
        A[size:, :size] -= slope.stiffness * np.outer(push, hub)
        A[size:, size:] -= slope.damping * np.outer(push, hub)
    # The row of the torsion angle is zero: torsion is no bending mode.
    return _with_sensors(
        model,
        _zero_order_hold(A, B, np.vstack([C, 0 * C[:1]]), linear_chain.drive_model(model), period),
        period,
    )


def sampled_chain(model: Model, period: float) -> tuple[SampledSystem, tuple[str, ...]]:
    """Returns the linearised chain of a rig, and the names of effects without linear form, which are left out.

    Args:
      model: rig and effects.
      period: sample period [s].
    """
    left_out = tuple(n for n, p in model.effects.items() if not linear_chain.has_linear_form(n, p))
    model = model.replace(effects={name: p for name, p in model.effects.items() if name not in left_out})
    A, B, C = linear_chain.linearised(model).first_order()
    rig = _zero_order_hold(A, B, C, linear_chain.drive_model(model), period)
    return _with_sensors(model, rig, period), left_out


def _with_sensors(model: Model, rig: SampledSystem, period: float) -> SampledSystem:
    """Adds the sensors: hub angle, tip, strains, torsion and motor torque (6) -> readings (5) with their delays."""
    slopes, delays = linear_chain.sensor_model(model)
    return _with_output_delays(SampledSystem(rig.A, rig.B, slopes @ rig.C), delays / period)


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
