"""Dead zone of the drive."""

from types import MappingProxyType

import numpy as np

from twin.effects.base import TORQUES, Effect, EffectParameter


class DeadZone(Effect):
    """Delivered torque = sign(tau) max(|tau| - w, 0) of the commanded torque tau, with the half width w.

    Above the zone it differs from Coulomb friction of the same level wherever torque and motion differ in sign.
    """

    name = "dead-zone"
    meaning = (
        "a drive that gives no torque below a level of the command, and beyond it what exceeds the level"
    )
    acts_on = "drive"
    seen_as = (
        "Small commands do nothing; of larger ones a constant amount is missing. The missing torque is the command "
        "itself up to `half_width`, and constant beyond."
    )
    mistaken_for = {
        "asymmetric-friction": "friction opposes the motion, a dead zone the command; a braking hub tells them apart",
    }
    source = "G. Tao and P. V. Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities, 1996"
    parameters = (EffectParameter("half_width", "N*m", 0.0, (0.0, 10.0), 1e-3, possible=TORQUES),)
    # A drive that lacks w of its torque is one that pushes against w more of friction, wherever it pushes.
    hidden_by = MappingProxyType({"static_friction": -1.0, "coulomb_friction": -1.0})

    def drive(self, drive, p):
        return drive.replace(
            torque=excess(drive.torque, p["half_width"]), before=float(excess(drive.before, p["half_width"]))
        )


def excess(torque, half_width):
    """The part of a torque (any shape) [N m] beyond a dead zone."""
    return np.sign(torque) * np.maximum(np.abs(torque) - half_width, 0.0)
