"""The paper's own model: one bending mode, and a friction law switched by the hub's rate.

The friction law of Bossi et al. 2009 (section IV), a simplified Karnopp model:

    f = tau_c sgn(theta_t)    where |theta_t| > d
        tau                   where the motor's torque |tau| < tau_s
        tau_s sgn(theta_t)    otherwise

In the limit d -> 0, a hub at rest behaves as follows, p being the torque of the bent link on the hub:

    |tau| < tau_s     slides in the direction of p once p + tau exceeds tau_c in that direction,
    otherwise         rests while |p + tau| is below tau_s.

So friction holds the hub against the motor but not against the bent link. Real friction depends on their sum only, as
in `twin.control.plants.modal`. This module implements the limit itself: with a finite d, results depend on the time
step as soon as the rate can pass the interval |theta_t| < d within one.
"""

from __future__ import annotations

import numpy as np

from twin.control.plants.base import PERIOD
from twin.control.plants.modal import ModalPlant
from twin.rigs.model import Model


class PaperPlant(ModalPlant):
    """The modal plant with the paper's number of modes and its friction law."""

    name = "paper"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = 1) -> None:
        """Prepares the modes of a model; see `ModalPlant`."""
        super().__init__(model, period, modes)

    def _stiction_margin(self, z: np.ndarray) -> float:
        needed, motor, q = float(self._needed @ z), self._motor_torque(z), z[: self._size]
        if abs(motor) >= self._forces.static(q, 1 if motor > 0 else -1):
            return super()._stiction_margin(z)
        pull = needed - motor
        upwards = min(pull, needed - self._forces.sliding(q, 1))
        downwards = min(-pull, -needed - self._forces.sliding(q, -1))
        return -max(upwards, downwards)
