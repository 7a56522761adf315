"""The linear loop, cut at the torque: closed-loop eigenvalues and margins with more modes than a synthesis knows.

The rig is its modal model (Bossi et al. 2009, section III), the hub sliding, without Coulomb friction; the torque is
held over a sample, and the controller is its linear form. With K(z) from readings to torque and P(z) from torque to
readings the loop is L = -K P, one input and one output whatever the controller reads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from twin import planar
from twin.effects import REGISTRY, Drive
from twin.mjcf import GAUGES
from twin.modal import state_space
from twin.model import Model
from twin.plants.base import READINGS
from twin.validation.linear_form import LinearForm

MODES = 3
"""Bending modes of the model that a loop is judged with; the paper's synthesis has one."""

_KNOWN = {"static_positive", "static_negative", "coulomb_positive", "coulomb_negative", "stribeck_velocity"}
_KNOWN |= {"friction_amplitude", "friction_order", "friction_phase", "bias", "disturbance_amplitude"}
_KNOWN |= {
    "disturbance_frequency",
    "disturbance_phase",
    "viscous",
    "cable_stiffness",
    "cable_rest_angle",
    "lag",
}
_FREQUENCIES = 1500  # of a margin, from 0.05 rad/s to half the sample rate
_LOWEST = 0.05


@dataclass(frozen=True)
class Sampled:
    """x+ = A x + B u, y = C x: a rig under a torque held over a sample; y in the order of `READINGS`."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray


@dataclass(frozen=True)
class Margins:
    """What the loop bears before it gets unstable.

    Attributes:
      growth: largest growth rate of the closed loop [1/s]; negative where it is stable.
      gain: smallest change of the loop gain, up or down [dB]; infinite where none does it.
      phase: smallest loss or gain of phase [deg].
      disk: disk margin of the balanced sensitivity (S - T)/2 [1]: Seiler, Packard and Gahinet, "An introduction to
        disk margins", IEEE Control Systems 40, 2020.
    """

    growth: float
    gain: float
    phase: float
    disk: float


def sampled_rig(model: Model, period: float, modes: int = MODES) -> tuple[Sampled, tuple[str, ...]]:
    """Returns the modal model of a rig with what its effects are at small amplitude, and the effects left out.

    Viscous friction, a cable, and gain, delay and lag of the drive are in; constant torques mean nothing to a
    linear loop.

    Args:
      model: rig and effects.
      period: sample period [s].
      modes: bending modes.
    """
    system = state_space(model.rig, modes, GAUGES)
    A, B, C = (np.asarray(m, dtype=float) for m in (system.A, system.B, system.C))
    size = modes + 1
    hub, plant = C[0, :size], model.plant
    A = A.copy()
    A[size:, :size] -= plant.cable_stiffness * np.outer(B[size:, 0], hub)
    A[size:, size:] -= plant.viscous * np.outer(B[size:, 0], hub)
    return _held(A, B, C, _drive(model), period), tuple(_left_out(model))


def margins(form: LinearForm, rig: Sampled, period: float) -> Margins:
    """Returns the margins of a controller on a rig."""
    closed = _closed(form, rig)
    growth = math.log(max(np.abs(np.linalg.eigvals(closed)).max(), 1e-300)) / period
    if growth >= 0:
        return Margins(growth, 0.0, 0.0, 0.0)
    frequencies = np.geomspace(_LOWEST, math.pi / period, _FREQUENCIES, endpoint=False)
    loop = _loop(form, rig, np.exp(1j * frequencies * period))
    return Margins(growth, *_classical(loop), disk_margin(loop))


def disk_margin(loop: np.ndarray) -> float:
    """Returns the disk margin of a stable loop's frequency response (m): min |2 (1 + L) / (1 - L)|."""
    with np.errstate(divide="ignore"):
        return float(np.min(2 * np.abs(1 + loop) / np.abs(1 - loop)))


def _classical(loop: np.ndarray) -> tuple[float, float]:
    """Gain margin [dB] and phase margin [deg] of a frequency response (m)."""
    # L crosses the negative real axis where its imaginary part changes sign to the left of the origin.
    i = np.flatnonzero((loop.imag[:-1] * loop.imag[1:] < 0) & (loop.real[:-1] < 0))
    share = loop.imag[i] / (loop.imag[i] - loop.imag[i + 1])
    real = loop.real[i] + share * (loop.real[i + 1] - loop.real[i])
    size = np.abs(loop)
    k = np.flatnonzero((size[:-1] - 1) * (size[1:] - 1) < 0)
    share = np.log(size[k]) / (np.log(size[k]) - np.log(size[k + 1]))
    # Angle from the critical point -1; between two frequencies it is interpolated.
    angle = np.angle(-loop[k]) + share * np.angle(loop[k + 1] / loop[k])
    gain = np.abs(20 * np.log10(-real[real < 0]))
    return float(gain.min(initial=math.inf)), float(np.degrees(np.abs(angle).min(initial=math.pi)))


def _loop(form: LinearForm, rig: Sampled, z: np.ndarray) -> np.ndarray:
    plant = _response(rig.A, rig.B, rig.C, z)[:, :, 0]
    control = _response(form.A, form.B, form.C, z)[:, 0, :] + form.D[0]
    return -np.sum(control * plant, axis=1)


def _response(A: np.ndarray, B: np.ndarray, C: np.ndarray, z: np.ndarray) -> np.ndarray:
    """C (z - A)^-1 B at each z (m): (m, outputs, inputs)."""
    return C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))


def _closed(form: LinearForm, rig: Sampled) -> np.ndarray:
    return np.block([[rig.A + rig.B @ form.D @ rig.C, rig.B @ form.C], [form.B @ rig.C, form.A]])


def _held(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, drive: tuple[float, float, float], period: float
) -> Sampled:
    """The rig at its samples; its state is that of the link, the torque behind a lag, and the last commands.

    Args:
      A, B, C: in continuous time, from delivered torque to four readings.
      drive: gain [1], delay [s] and lag [s].
      period: sample period [s].
    """
    gain, delay, lag = drive
    whole = int(delay / period + 1e-9)
    late = max(delay - whole * period, 0.0)
    moved, n = len(A) + (lag > 0), len(A)
    inner = np.zeros((moved + 1, moved + 1))
    inner[:n, :n] = A
    inner[:n, n] = B[:, 0] * (1.0 if lag > 0 else gain)
    if lag > 0:
        inner[n, n:] = -1 / lag, gain / lag
    first, second = expm(inner * late), expm(inner * (period - late))
    # Within a sample the command of whole + 1 samples ago acts first, then the one after it.
    states = np.zeros((moved + whole + 1,) * 2)
    push = np.zeros((len(states), 1))
    states[:moved, :moved] = second[:moved, :moved] @ first[:moved, :moved]
    states[:moved, -1] = second[:moved, :moved] @ first[:moved, moved]
    if whole:
        states[:moved, -2] += second[:moved, moved]
    else:
        push[:moved, 0] = second[:moved, moved]
    # Commands on their way, the newest first.
    push[moved, 0] = 1.0
    states[moved + 1 :, moved:-1] = np.eye(whole)
    read = np.zeros((len(READINGS), len(states)))
    read[:-1, :n] = C
    read[-1, n if lag > 0 else -1] = 1.0 if lag > 0 else gain
    return Sampled(states, push, read)


def _drive(model: Model) -> tuple[float, float, float]:
    """Gain [1], delay [s] and lag [s] that the effects give the drive."""
    answers = []
    for torque in (0.0, 1.0):
        drive = Drive(np.zeros(1), np.array([torque]))
        for name, p in model.effects.items():
            drive = REGISTRY[name].drive(drive, p)
        answers.append(drive)
    rest, one = answers
    return float(one.torque[0] - rest.torque[0]), float(one.time[0]), max(model.plant.lag, one.lag)


def _left_out(model: Model) -> list[str]:
    """Effects that change more in the equations of motion than the linear loop knows."""
    declared = planar.declared_plant(model.rig, model.chain)
    names = []
    for name, p in model.effects.items():
        effect = REGISTRY[name]
        plant, links = effect.plant(declared, p), effect.links(model.chain, model.rig, p)
        fields = planar.Plant._fields
        changed = {f for f in fields if not np.array_equal(getattr(plant, f), getattr(declared, f))}
        if changed - _KNOWN or links is not model.chain:
            names.append(name)
    return names
