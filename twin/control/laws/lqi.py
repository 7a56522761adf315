"""The paper's LQ regulator with observer and integral action, for two measurements.

It works on the error state [alpha - reference, delta_1, alpha_t, delta_1_t, v] with v_t = hub_angle - reference,
u = -K x, K from the weights of Bossi et al. 2009, section V; the observer has the poles -5, -5, -10, -10 and
measures the hub angle's error and the tip deflection. With absolute states instead, the reference would act through
the slow integrator only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

WEIGHTS = (50.0, 1.0, 1.0, 1.0, 0.05)
"""Diagonal of Q, of the error state in SI units; section V."""
TORQUE_WEIGHT = 1000.0
"""R [1/(N m)^2]; section V."""
OBSERVER_POLES = (-5.0, -5.0, -10.0, -10.0)
"""Poles of the observer [1/s]; section V."""


class LqiController:
    """LQ regulator with observer and integral action.

    Anti-windup: the observer's input is the limited torque, and the integrator is held while the limit is reached and
    the error would increase the torque further. The observer's estimate is shifted by every change of the reference, as
    a jump of the error is then no motion of the hub.
    """

    def __init__(
        self, observer: tuple[np.ndarray, np.ndarray], gains: np.ndarray, period: float, limit: float
    ) -> None:
        """Takes the discrete observer x+ = A x + B [u, y], the gains K (5) on [x, v], the period and the limit.

        Args:
          observer: A (4, 4) and B (4, 3); its inputs are torque [N m], hub angle's error [rad], deflection [m].
          gains: K (5).
          period: sample period [s].
          limit: of the amplifier [N m].
        """
        self._A, self._B = observer
        self._gains, self._period, self._limit = gains, period, limit
        self.reset()

    @property
    def states(self) -> dict[str, float]:
        """Estimated error state and the integral of the error."""
        names = ("alpha_error", "delta_1", "alpha_t", "delta_1_t")
        return {**dict(zip(names, self._x.tolist(), strict=True)), "integral": self._v}

    def reset(self) -> None:
        """Resets the estimate, which starts at rest at the first measurement, and the integral to zero."""
        self._x, self._v = np.zeros(4), 0.0
        self._reference: float | None = None

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        error = measured["hub_angle"] - reference
        if self._reference is None:
            self._x[0] = error
        else:
            self._x[0] -= reference - self._reference
        self._reference = reference
        unlimited = -float(self._gains[:4] @ self._x + self._gains[4] * self._v)
        u = min(max(unlimited, -self._limit), self._limit)
        if u == unlimited or unlimited * error > 0:  # the integral of a positive error reduces the torque
            self._v += self._period * error
        self._x = self._A @ self._x + self._B @ np.array([u, error, measured["tip_deflection"]])
        return u


def lqi(rig: Mapping[str, float], period: float) -> LqiController:
    """Designs the regulator with the modal model of one mode.

    The design is in continuous time, as in the paper; the observer is discretised with a zero-order hold, the integral
    by Euler's rule.

    Args:
      rig: parameters of the design model, torque_limit included.
      period: sample period [s].
    """
    A, B, C, K, L = design(rig)
    import control

    observer = control.ss(A - L @ C, np.hstack([B, L]), np.eye(4), 0)
    held = control.sample_system(observer, period, "zoh")
    limit = float(rig.get("torque_limit", math.inf))
    return LqiController((np.asarray(held.A), np.asarray(held.B)), K, period, limit)


def design(
    rig: Mapping[str, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns A, B, C of the modal model with one mode, the gains K (5) and the observer gains L (4, 2)."""
    import control

    from twin.mechanics.modal import state_space

    model = state_space(rig, 1)
    A, B, C = (np.asarray(m) for m in (model.A, model.B, model.C))
    whole, push = _with_integral(A, B, C)
    K = np.asarray(control.lqr(whole, push, np.diag(WEIGHTS), [[TORQUE_WEIGHT]])[0])[0]
    L = np.asarray(control.place(A.T, C.T, OBSERVER_POLES)).T
    return A, B, C, K, L


def least_damped_mode(rig: Mapping[str, float]) -> tuple[float, float]:
    """Returns frequency [Hz] and damping ratio [1] of the closed loop's least damped mode, which a reference excites.

    The observer knows the reference, so that a change of it excites the poles of the regulator only.
    """
    A, B, C, K, _ = design(rig)
    whole, push = _with_integral(A, B, C)
    poles = np.linalg.eigvals(whole - push @ K[None, :])
    pole = poles[np.argmin(-poles.real / np.abs(poles))]
    return float(np.abs(pole)) / (2 * math.pi), float(-pole.real / np.abs(pole))


def _with_integral(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns A (5, 5) and B (5, 1) with the integral of the hub angle's error as the last state."""
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[4, :4] = A, C[0]
    return whole, np.vstack([B, [[0.0]]])
