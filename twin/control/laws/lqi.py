"""The paper's LQ regulator with observer and integral action, for two measurements.

It works on the error state [alpha - reference, delta_1, alpha_t, delta_1_t, v] with v_t = hub_angle - reference,
u = -K x, K from the weights of Bossi et al. 2009, section V; the observer has the poles -5, -5, -10, -10 on the
hub angle's error and the tip deflection. Fed with absolute states instead, the reference would enter through the
slow integrator alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

WEIGHTS = (50.0, 1.0, 1.0, 1.0, 0.05)
TORQUE_WEIGHT = 1000.0
OBSERVER_POLES = (-5.0, -5.0, -10.0, -10.0)


class LqiController:
    """LQ regulator with observer and integral action.

    Anti-windup: the observer is told the torque after the amplifier's limit, and the integrator stands still
    while that limit is reached and the error would push further into it. The observer is told where the reference
    goes as well: a jump of it is no motion of the hub.
    """

    def __init__(
        self, observer: tuple[np.ndarray, np.ndarray], gains: np.ndarray, period: float, limit: float
    ) -> None:
        """Takes the discrete observer x+ = A x + B [u, y], the gains K (5) on [x, v], the period and the limit.

        Args:
          observer: A (4, 4) and B (4, 3), its inputs the torque [N m], hub angle's error [rad], deflection [m].
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
        """The estimate starts from the first measurement, at rest; the integral at zero."""
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
        wanted = -float(self._gains[:4] @ self._x + self._gains[4] * self._v)
        u = min(max(wanted, -self._limit), self._limit)
        if u == wanted or wanted * error > 0:  # more error needs less torque
            self._v += self._period * error
        self._x = self._A @ self._x + self._B @ np.array([u, error, measured["tip_deflection"]])
        return u


def lqi(rig: Mapping[str, float], period: float) -> LqiController:
    """Synthesises the regulator from the modal model with one mode.

    Designed in continuous time, as in the paper; the observer is discretised exactly for inputs held over a
    sample, the integral by Euler's rule.

    Args:
      rig: parameters of the model that the synthesis believes in, torque_limit included.
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
    """Returns A, B, C of the model with one mode, the gains K (5) and the observer's L (4, 2)."""
    import control

    from twin.mechanics.modal import state_space

    model = state_space(rig, 1)
    A, B, C = (np.asarray(m) for m in (model.A, model.B, model.C))
    whole, push = _with_integral(A, B, C)
    K = np.asarray(control.lqr(whole, push, np.diag(WEIGHTS), [[TORQUE_WEIGHT]])[0])[0]
    L = np.asarray(control.place(A.T, C.T, OBSERVER_POLES)).T
    return A, B, C, K, L


def least_damped_mode(rig: Mapping[str, float]) -> tuple[float, float]:
    """Returns frequency [Hz] and damping ratio of the least damped mode of the loop: what a reference makes ring.

    The observer is told the reference, so that it excites the poles of the regulator alone.
    """
    A, B, C, K, _ = design(rig)
    whole, push = _with_integral(A, B, C)
    poles = np.linalg.eigvals(whole - push @ K[None, :])
    pole = poles[np.argmin(-poles.real / np.abs(poles))]
    return float(np.abs(pole)) / (2 * math.pi), float(-pole.real / np.abs(pole))


def _with_integral(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (5, 5) and B (5, 1) with the integral of the hub angle's error as the last state."""
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[4, :4] = A, C[0]
    return whole, np.vstack([B, [[0.0]]])
