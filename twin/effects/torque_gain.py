"""Gain error of the drive."""

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter


class TorqueGain(Effect):
    """Delivered torque = gain * commanded torque, after its saturation."""

    name = "torque-gain"
    meaning = "a gain error of the drive"
    acts_on = "drive"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 1e-2, possible=GAIN_ERRORS),)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque * p["gain"], before=drive.before * p["gain"])
