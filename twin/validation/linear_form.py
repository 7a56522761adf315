"""State-space form of a controller, identified from its pulse responses around rest.

The controller gets a pulse on one reading after another. If the responses are linear and time-invariant, they are the
Markov parameters h_k = C A^(k-1) B, which have a state-space realisation (J.-N. Juang and R. S. Pappa, "An eigensystem
realization algorithm for modal parameter identification and model reduction", J. Guidance 8, 1985).
"""

from __future__ import annotations

from collections.abc import Callable
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
"""Pulse on each reading, SI: small, so that the torque stays far below any limit; rounding errors are 1e-11 of it."""
_HANKEL_SAMPLES = np.unique(np.geomspace(1, 600, 100).astype(int)) - 1
"""Rows and columns of the Hankel matrix [samples]: dense at first for fast poles, up to 600 for slow ones."""
_RECORD_LENGTH = 2 * int(_HANKEL_SAMPLES[-1]) + 3  # samples of a pulse response that the Hankel matrices need
_SETTLING_SAMPLES = 20  # samples at rest before a pulse: a first reading may initialise an observer
_RANK_TOLERANCE = 1e-10  # smallest singular value that is kept, over the largest [1]
_TOLERANCE = 1e-5  # relative difference of two responses up to which they are equal [1]


@dataclass(frozen=True)
class LinearForm:
    """x+ = A x + B y, u = C x + D y, with the readings y in the order of `READINGS` and k states.

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
        """Returns the torque (m) [N m] in response to readings (m, 5), SI, from rest."""
        x, torque = np.zeros(len(self.A)), np.empty(len(readings))
        for k, y in enumerate(readings):
            torque[k] = (self.C @ x + self.D @ y)[0]
            x = self.A @ x + self.B @ y
        return torque


class NoLinearFormError(ValueError):
    """The controller is not linear and time-invariant around rest, or no realisation of it was found."""


def linear_form_of(controller: Controller, period: float) -> LinearForm:
    """Returns the linear form of a controller around rest at zero.

    Args:
      controller: called once per sample; it is reset.
      period: sample period [s].

    Raises:
      NoLinearFormError: its responses are not those of a linear, time-invariant system.
    """
    scales = np.array([PULSES[name] for name in READINGS])
    rest = _torque_response(
        controller, np.zeros((_SETTLING_SAMPLES + _RECORD_LENGTH, len(READINGS))), period
    )[_SETTLING_SAMPLES:]

    def respond(readings: np.ndarray) -> np.ndarray:
        before = np.zeros((_SETTLING_SAMPLES, len(READINGS)))
        return (
            _torque_response(controller, np.vstack([before, readings * scales]), period)[_SETTLING_SAMPLES:]
            - rest
        )

    pulses = np.stack([respond(_unit_pulse(i)) for i in range(len(READINGS))])
    if not pulses.any():
        raise NoLinearFormError("it does not respond to small changes of its readings around rest")
    random = np.random.default_rng(0).standard_normal((_RECORD_LENGTH, len(READINGS)))
    _check_linearity(respond, pulses)
    form = _realisation(pulses.T)
    if not _equal(form.response(random), respond(random)):
        raise NoLinearFormError(
            "its response to a random signal is not the superposition of its pulse responses"
        )
    return LinearForm(form.A, form.B / scales, form.C, form.D / scales)


def _check_linearity(respond: Callable[[np.ndarray], np.ndarray], pulses: np.ndarray) -> None:
    """Checks superposition, homogeneity and time invariance on pulses on all readings at once.

    Args:
      respond: scaled readings (m, 5) -> torque (m) [N m].
      pulses: (5, m) response to a unit pulse on each reading.

    Raises:
      NoLinearFormError: one of them fails.
    """
    together = np.sum([_unit_pulse(i) for i in range(len(READINGS))], axis=0)
    whole = pulses.sum(axis=0)
    if not _equal(respond(together), whole):
        raise NoLinearFormError("responses to pulses on single readings do not add up")
    if not _equal(respond(-3 * together), -3 * whole):
        raise NoLinearFormError("a pulse times -3 does not have -3 times the response")
    late = _RECORD_LENGTH // 3
    if not _equal(respond(np.roll(together, late, axis=0))[late:], whole[:-late]):
        raise NoLinearFormError("a later pulse has another response: the controller depends on time")


def _unit_pulse(reading: int) -> np.ndarray:
    """Readings (m, 5) with a one at the first sample of one of them."""
    readings = np.zeros((_RECORD_LENGTH, len(READINGS)))
    readings[0, reading] = 1.0
    return readings


def _torque_response(controller: Controller, readings: np.ndarray, period: float) -> np.ndarray:
    """Torque (m) [N m] of the controller on readings (m, 5), with the reference at zero."""
    controller.reset()
    torque = np.empty(len(readings))
    for k, values in enumerate(readings.tolist()):
        measured = {**dict(zip(READINGS, values, strict=True)), "time": k * period}
        torque[k] = controller.torque(measured, 0.0)
    return torque


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.abs(one - other).max() <= _TOLERANCE * max(np.abs(one).max(), np.abs(other).max()))


def _realisation(responses: np.ndarray) -> LinearForm:
    """Realisation of the responses (m, r) to unit pulses on r readings by the eigensystem realisation algorithm."""
    readings = responses.shape[1]
    markov = responses[1:]
    # Rows are later instants of the response, columns earlier instants of the pulse.
    apart = _HANKEL_SAMPLES[:, None] + _HANKEL_SAMPLES
    hankel, next_one = (markov[apart + late].reshape(len(_HANKEL_SAMPLES), -1) for late in (0, 1))
    left, size, right = np.linalg.svd(hankel, full_matrices=False)
    kept = size > _RANK_TOLERANCE * max(size[0], np.finfo(float).tiny)
    root = np.sqrt(size[kept])
    observability, controllability = left[:, kept] * root, root[:, None] * right[kept]
    A = (left[:, kept] / root).T @ next_one @ (right[kept] / root[:, None]).T
    return LinearForm(A, controllability[:, :readings], observability[:1], responses[:1])
