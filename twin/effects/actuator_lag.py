"""First-order lag between commanded and delivered torque."""

from twin.effects.base import TIMES, Effect, EffectParameter


class ActuatorLag(Effect):
    """time_constant d(delivered)/dt = commanded - delivered torque."""

    name = "actuator-lag"
    meaning = "a drive that follows its command with a first-order lag"
    acts_on = "drive"
    parameters = (EffectParameter("time_constant", "s", 0.0, (0.0, 0.5), 1e-3, possible=TIMES),)

    def drive(self, drive, p):
        return drive.replace(lag=p["time_constant"])

    def plant(self, plant, p):
        return plant.with_motor(lag=p["time_constant"])
