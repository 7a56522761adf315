"""Gain error of the drive."""

import re

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter


class TorqueGain(Effect):
    """Delivered torque = gain * commanded torque, after its saturation.

    A sensor of the torque reads it. With `behind_sensor` 1 it reads the torque before the gain, as a current sensor
    does behind which the motor constant is wrong.
    """

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
    parameters = (
        EffectParameter("gain", "1", 1.0, (0.1, 10.0), 1e-2, possible=GAIN_ERRORS),
        EffectParameter("behind_sensor", "1", 0.0, (0.0, 1.0), 1.0, "motor_torque", choice=True),
    )
    undefined_at_neutral = ("behind_sensor",)
    channel_errors = {"gain": (("gain", "torque_command"),)}
    measured_by = "motor_torque"

    def starts(self, rig):
        return tuple({"gain": 1.01, "behind_sensor": choice} for choice in (0.0, 1.0))

    def fits(self, values, sensors):
        declared = sensors["motor_torque"].sees_gain if "motor_torque" in sensors else None
        return declared is None or values.get("behind_sensor", 0.0) == float(not declared)

    def drive(self, drive, p):
        return drive.replace(torque=drive.torque * p["gain"], before=drive.before * p["gain"])

    def taken_over(self, p, parameter, value, unit):
        # Without a sensor of the torque, nothing tells the gain from the unit of mass: all motions are the same if
        # inertias, stiffnesses and frictions are divided by it.
        return value / p["gain"] if has_mass(unit) else value

    # It changes no reading of the motion.
    acts_on_readings = False

    def reading(self, reading, channel, p):
        seen = channel != "motor_torque" or p.get("behind_sensor", 0.0) != 1.0
        return reading if seen else reading.scaled(1 / p["gain"])

    def sensing(self, time, channels, p):
        if "motor_torque" not in channels or p.get("behind_sensor", 0.0) != 1.0:
            return channels
        return {**channels, "motor_torque": channels["motor_torque"] / p["gain"]}


def has_mass(unit):
    """Whether a quantity with this SI unit is proportional to the unit of mass, as a torque or an inertia is."""
    return re.match(r"(N|kg)\b", unit) is not None
