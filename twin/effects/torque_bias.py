"""Constant offset of the delivered torque."""

from twin.effects.base import TORQUES, Effect, EffectParameter


class TorqueBias(Effect):
    """Delivered torque = commanded torque + bias: an amplifier with an offset."""

    name = "torque-bias"
    meaning = "a constant torque on the hub"
    acts_on = "drive"
    seen_as = (
        "A hub that should rest drifts to one side, and slews to that side go farther. The missing torque is a "
        "constant."
    )
    mistaken_for = {
        "gravity-tilt": "a wide range of hub angles: gravity's torque changes with the angle",
    }
    source = "a definition: the offset of an amplifier"
    parameters = (EffectParameter("bias", "N*m", 0.0, (-1.0, 1.0), 1e-4, possible=(-TORQUES[1], TORQUES[1])),)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque + p["bias"], before=drive.before + p["bias"])
