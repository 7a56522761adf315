"""Dead time between commanded and delivered torque."""

from twin.effects.base import TIMES, TIMING_TOLERANCE, Effect, EffectParameter


class ActuatorDelay(Effect):
    """Delivered torque(t) = commanded torque(t - delay)."""

    name = "actuator-delay"
    meaning = "a drive that follows its command after a dead time"
    acts_on = "drive"
    parameters = (EffectParameter("delay", "s", 0.0, (0.0, 0.2), 2e-3, possible=TIMES),)

    def is_resolved(self, values, period):
        return values["delay"] >= TIMING_TOLERANCE * period

    def drive(self, drive, p):
        return drive.replace(time=drive.time + p["delay"])
