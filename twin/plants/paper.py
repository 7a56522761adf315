"""The paper's own model: one bending mode, and a friction that is switched by the hub's rate.

Bossi et al. 2009 let friction equal the motor's torque, up to the static level, while the hub is slower than a small
rate d, and tau_c beyond it. As d goes to zero, a hub at rest

    withstands      the motor alone, up to tau_s,
    slides on       once the link's pull is not opposed by it and, with the motor's torque, exceeds tau_c:

the static level holds the hub against the motor, not against the link. On a rig nothing tells friction where a torque
comes from: `twin.plants.modal` has the same level against their sum. The limit itself is taken here, since how large d
is changes figures as soon as a step of time passes it.
"""

from __future__ import annotations

import numpy as np

from twin.model import Model
from twin.plants.base import PERIOD
from twin.plants.modal import ModalPlant


class PaperPlant(ModalPlant):
    """The modal plant with the paper's number of modes and its switch of friction."""

    name = "paper"

    def __init__(self, model: Model, period: float = PERIOD, modes: int = 1) -> None:
        """Prepares the modes of a model; see `ModalPlant`."""
        super().__init__(model, period, modes)

    def _held(self, z: np.ndarray) -> float:
        needed, motor, q = float(self._needed @ z), self._motor_torque(z), z[: self._size]
        withstood = np.clip(motor, -self._forces.static(q, -1), self._forces.static(q, 1))
        pull = needed - withstood
        upwards = min(pull, needed - self._forces.sliding(q, 1))
        downwards = min(-pull, -needed - self._forces.sliding(q, -1))
        return -max(upwards, downwards)
