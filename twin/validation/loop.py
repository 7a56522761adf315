"""The linear loop, cut at the torque: eigenvalues and margins of a controller's linear form on a sampled rig.

With K(z) from readings to torque and P(z) from torque to readings the loop is L = -K P, one input and one output
whatever the controller reads. python-control gives the same margins (a test says so) in ten times the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.validation.linear_form import LinearForm
from twin.validation.linear_rig import Sampled

_FREQUENCIES = 1500  # of a margin, from 0.05 rad/s to half the sample rate
_LOWEST = 0.05


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
