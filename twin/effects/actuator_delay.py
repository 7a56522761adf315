"""Dead time between command and torque."""

from twin.effects.base import OPEN, Effect, EffectParameter


class ActuatorDelay(Effect):
    """delivered(t) = commanded(t - delay)."""

    name = "actuator-delay"
    meaning = "a drive that follows its command after a dead time"
    acts_on = "drive"
    parameters = (EffectParameter("delay", "s", 0.0, (0.0, 0.2), 2e-3),)

    def resolved(self, values, period):
        return values["delay"] >= OPEN * period

    def drive(self, drive, p):
        return drive.replace(time=drive.time + p["delay"])
