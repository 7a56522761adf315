"""The linear form of a controller of which only the answers are known, from its response to pulses.

A controller is fed with a pulse on one reading after another, around rest at zero. If its answers scale, add up,
change sign and do not depend on when the pulse comes, they are its Markov parameters h_k = C A^(k-1) B, from which
a realisation follows (J.-N. Juang and R. S. Pappa, "An eigensystem realization algorithm for modal parameter
identification and model reduction", J. Guidance 8, 1985).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.control.laws.base import Controller
from twin.control.plants.base import READINGS

PULSES = {
    "hub_angle": 1e-5,
    "tip_deflection": 1e-5,
    "strain_base": 1e-7,
    "strain_mid": 1e-7,
    "motor_torque": 1e-5,
}
"""Pulse on each reading, SI: small, so that the torque stays far below any limit; rounding is 1e-11 of it."""

_INSTANTS = np.unique(np.geomspace(1, 600, 100).astype(int)) - 1
"""Rows and columns of the Hankel matrix [samples]: dense at first for what is quick, far for what is slow."""
_LENGTH = 2 * int(_INSTANTS[-1]) + 3
_SETTLE = 20  # samples at rest before a pulse: a first reading may set an estimate
_RANK = 1e-10  # of the largest singular value
_ALIKE = 1e-5  # relative difference of two answers that counts as none


@dataclass(frozen=True)
class LinearForm:
    """x+ = A x + B y, u = C x + D y, with y the readings in the order of `READINGS`; k states.

    Attributes:
      A: (k, k).
      B: (k, 5).
      C: (1, k).
      D: (1, 5).
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    def response(self, readings: np.ndarray) -> np.ndarray:
        """Torque (m) [N m] that readings (m, 5) lead to from rest."""
        x, torque = np.zeros(len(self.A)), np.empty(len(readings))
        for k, y in enumerate(readings):
            torque[k] = (self.C @ x + self.D @ y)[0]
            x = self.A @ x + self.B @ y
        return torque


class NoLinearFormError(ValueError):
    """The controller is not linear and time-invariant around rest, or no realisation of it was found."""


def identify(controller: Controller, period: float) -> LinearForm:
    """Returns the linear form of a controller around rest at zero; it is reset.

    Args:
      controller: called once a sample.
      period: sample period [s].

    Raises:
      NoLinearFormError: its answers are not those of a linear, time-invariant system.
    """
    scales = np.array([PULSES[name] for name in READINGS])
    rest = _torque(controller, np.zeros((_SETTLE + _LENGTH, len(READINGS))), period)[_SETTLE:]

    def answer(readings: np.ndarray) -> np.ndarray:
        before = np.zeros((_SETTLE, len(READINGS)))
        return _torque(controller, np.vstack([before, readings * scales]), period)[_SETTLE:] - rest

    pulses = np.stack([answer(_pulse(i)) for i in range(len(READINGS))])
    if not pulses.any():
        raise NoLinearFormError("it does not respond to small changes of its readings around rest")
    random = np.random.default_rng(0).standard_normal((_LENGTH, len(READINGS)))
    _check_linear(answer, pulses)
    found = _realised(pulses.T)
    if not _alike(found.response(random), answer(random)):
        raise NoLinearFormError("its answer to a random signal is not what its answers to pulses add up to")
    return LinearForm(found.A, found.B / scales, found.C, found.D / scales)


def _check_linear(answer, pulses: np.ndarray) -> None:
    """Scale, sign and instant of a pulse on all readings at once."""
    together = sum(_pulse(i) for i in range(len(READINGS)))
    whole = pulses.sum(axis=0)
    if not _alike(answer(together), whole):
        raise NoLinearFormError("answers to pulses on single readings do not add up")
    if not _alike(answer(-3 * together), -3 * whole):
        raise NoLinearFormError(
            "a pulse three times as large, the other way, has another answer than that times -3"
        )
    late = _LENGTH // 3
    if not _alike(answer(np.roll(together, late, axis=0))[late:], whole[:-late]):
        raise NoLinearFormError("a later pulse has another answer: the controller depends on time")


def _pulse(reading: int) -> np.ndarray:
    readings = np.zeros((_LENGTH, len(READINGS)))
    readings[0, reading] = 1.0
    return readings


def _torque(controller: Controller, readings: np.ndarray, period: float) -> np.ndarray:
    controller.reset()
    torque = np.empty(len(readings))
    for k, values in enumerate(readings.tolist()):
        measured = {**dict(zip(READINGS, values, strict=True)), "time": k * period}
        torque[k] = controller.torque(measured, 0.0)
    return torque


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(one - other).max() <= _ALIKE * max(np.abs(one).max(), np.abs(other).max()))


def _realised(answers: np.ndarray) -> LinearForm:
    """Realisation of the answers (m, r) to unit pulses on r readings."""
    readings = answers.shape[1]
    markov = answers[1:]
    # Rows are later instants of the answer, columns earlier instants of the pulse.
    apart = _INSTANTS[:, None] + _INSTANTS
    hankel, next_one = (markov[apart + late].reshape(len(_INSTANTS), -1) for late in (0, 1))
    left, size, right = np.linalg.svd(hankel, full_matrices=False)
    kept = size > _RANK * max(size[0], np.finfo(float).tiny)
    root = np.sqrt(size[kept])
    seen, reached = left[:, kept] * root, root[:, None] * right[kept]
    A = (left[:, kept] / root).T @ next_one @ (right[kept] / root[:, None]).T
    return LinearForm(A, reached[:, :readings], seen[:1], answers[:1])
