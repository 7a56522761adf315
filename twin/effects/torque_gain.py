"""Gain error of the drive."""

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter


class TorqueGain(Effect):
    """Delivered torque = gain * commanded torque, after its saturation."""

    name = "torque-gain"
    meaning = "a gain error of the drive"
    acts_on = "drive"
    seen_as = (
        "All motions are too large or too small by the same share, at every speed and angle. The missing torque is "
        "proportional to the command."
    )
    mistaken_for = {
        "payload-mass": "a payload changes the frequencies of the link, a gain does not",
        "hub-sensor-gain": "a torque sensor at the shaft, or the frequencies of the link beside its strains",
    }
    source = "a definition; torque constants in data sheets have a tolerance"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 1e-2, possible=GAIN_ERRORS),)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque * p["gain"], before=drive.before * p["gain"])
