"""The paper's own model: one bending mode, and a friction that is switched by the hub's rate.

The switch of Bossi et al. 2009 (section IV there):

    f = tau_c sgn(theta_t)    where |theta_t| > d
        tau                   where the motor's torque |tau| < tau_s
        tau_s sgn(theta_t)    otherwise

As d goes to zero, a hub at rest

    |tau| < tau_s     slides to where the link pulls once pull and motor together exceed tau_c,
    otherwise         rests while pull and motor together are below tau_s.

A motor below tau_s is held whatever it is, a bent link is not. On a rig nothing tells friction where a torque comes
from: `twin.control.plants.modal` has the static level against their sum. The limit itself is taken here, since how
large d is changes figures as soon as a step of time passes it.
"""

from __future__ import annotations

import numpy as np

from twin.control.plants.base import PERIOD
from twin.control.plants.modal import ModalPlant
from twin.rigs.model import Model


class PaperPlant(ModalPlant):
    """The modal plant with the paper's number of modes and its switch of friction."""

    name = "paper"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = 1) -> None:
        """Prepares the modes of a model; see `ModalPlant`."""
        super().__init__(model, period, modes)

    def _held(self, z: np.ndarray) -> float:
        needed, motor, q = float(self._needed @ z), self._motor_torque(z), z[: self._size]
        if abs(motor) >= self._forces.static(q, 1 if motor > 0 else -1):
            return super()._held(z)
        pull = needed - motor
        upwards = min(pull, needed - self._forces.sliding(q, 1))
        downwards = min(-pull, -needed - self._forces.sliding(q, -1))
        return -max(upwards, downwards)
