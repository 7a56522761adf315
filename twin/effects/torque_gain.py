"""A drive that delivers more or less than it was asked for."""

from twin.effects.base import Effect, EffectParameter


class TorqueGain(Effect):
    """delivered = gain * commanded, behind the saturation."""

    name = "torque-gain"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 1e-2),)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque * p["gain"], before=drive.before * p["gain"])
