"""Stability margins of the linear loop, broken at the torque, of a controller on a sampled rig.

With K(z) from readings to torque and P(z) from torque to readings the loop transfer function is L = -K P: it has one
input and one output, whatever the controller reads. python-control gives the same margins, which a test checks, in ten
times the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.validation.linear_form import LinearForm
from twin.validation.linear_rig import SampledSystem

_FREQUENCIES = 1500  # number of frequencies, logarithmic up to half the sample rate
_LOWEST_FREQUENCY = 0.05  # rad/s


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop; all but `growth` are 0 where it is unstable.

    Attributes:
      growth: largest growth rate of the closed loop [1/s]; negative where it is stable.
      gain: smallest change of the loop gain, up or down, that destabilises [dB]; infinite where none does.
      phase: smallest change of phase, lag or lead, that destabilises [deg].
      disk: disk margin of the balanced sensitivity (S - T)/2 [1]: Seiler, Packard and Gahinet, "An introduction to
        disk margins", IEEE Control Systems 40, 2020.
    """

    growth: float
    gain: float
    phase: float
    disk: float


def margins(form: LinearForm, rig: SampledSystem, period: float) -> Margins:
    """Returns the margins of a controller on a rig; `period` is the sample period [s]."""
    closed = _closed_loop_matrix(form, rig)
    growth = math.log(max(np.abs(np.linalg.eigvals(closed)).max(), 1e-300)) / period
    if growth >= 0:
        return Margins(growth, 0.0, 0.0, 0.0)
    frequencies = np.geomspace(_LOWEST_FREQUENCY, math.pi / period, _FREQUENCIES, endpoint=False)
    loop = _loop_response(form, rig, np.exp(1j * frequencies * period))
    return Margins(growth, *_gain_and_phase_margin(loop), disk_margin(loop))


def disk_margin(loop: np.ndarray) -> float:
    """Returns the disk margin of a stable loop's frequency response (m): min |2 (1 + L) / (1 - L)|."""
    with np.errstate(divide="ignore"):
        return float(np.min(2 * np.abs(1 + loop) / np.abs(1 - loop)))


def _gain_and_phase_margin(loop: np.ndarray) -> tuple[float, float]:
    """Gain margin [dB] and phase margin [deg] of a loop's frequency response (m), interpolated between frequencies."""
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


def _loop_response(form: LinearForm, rig: SampledSystem, z: np.ndarray) -> np.ndarray:
    """L (m) at z (m)."""
    plant = _frequency_response(rig.A, rig.B, rig.C, z)[:, :, 0]
    control = _frequency_response(form.A, form.B, form.C, z)[:, 0, :] + form.D[0]
    return -np.sum(control * plant, axis=1)


def _frequency_response(A: np.ndarray, B: np.ndarray, C: np.ndarray, z: np.ndarray) -> np.ndarray:
    """C (z - A)^-1 B at each z (m): (m, outputs, inputs)."""
    return C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))


def _closed_loop_matrix(form: LinearForm, rig: SampledSystem) -> np.ndarray:
    """State matrix of the closed loop, states of the rig first."""
    return np.block([[rig.A + rig.B @ form.D @ rig.C, rig.B @ form.C], [form.B @ rig.C, form.A]])
