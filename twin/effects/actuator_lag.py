"""First-order lag between commanded and delivered torque."""

from twin.effects.base import TIMES, Effect, EffectParameter


class ActuatorLag(Effect):
    """time_constant d(delivered)/dt = commanded - delivered torque."""

    name = "actuator-lag"
    meaning = "a drive that follows its command with a first-order lag"
    acts_on = "drive"
    seen_as = (
        "Each edge of the torque is rounded, and the motion late. The missing torque follows every step of the command "
        "and fades within a few `time_constant`s."
    )
    mistaken_for = {
        "actuator-delay": "samples that are fast beside the lag: a lag rounds an edge, a delay moves it",
        "sensor-delay": "a delay of the sensors also moves what happens while the command rests",
    }
    source = "a closed current loop, taken as of first order (assumed)"
    parameters = (EffectParameter("time_constant", "s", 0.0, (0.0, 0.5), 1e-3, possible=TIMES),)

    def drive(self, drive, p):
        return drive.replace(lag=p["time_constant"])

    def plant(self, plant, p):
        return plant.with_motor(lag=p["time_constant"])
