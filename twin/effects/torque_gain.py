"""A drive that delivers more or less than it was asked for."""

from twin.effects.base import Effect, EffectParameter


class TorqueGain(Effect):
    """delivered = gain * commanded, behind the saturation."""

    name = "torque-gain"
    meaning = "a drive that delivers another multiple of the commanded torque"
    acts_on = "drive"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 1e-2),)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque * p["gain"], before=drive.before * p["gain"])
