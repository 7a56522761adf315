"""Dead time between commanded and delivered torque."""

from twin.effects.base import TIMES, TIMING_TOLERANCE, Effect, EffectParameter


class ActuatorDelay(Effect):
    """Delivered torque(t) = commanded torque(t - delay)."""

    name = "actuator-delay"
    meaning = "a drive that follows its command after a dead time"
    acts_on = "drive"
    seen_as = (
        "The motion starts late after each edge of the command, by the same time. The missing torque is a short pulse "
        "at each edge."
    )
    mistaken_for = {
        "sensor-delay": "a torque sensor, or a free vibration with the hub locked, which no command moves",
    }
    source = "K. J. Åström and B. Wittenmark, Computer-Controlled Systems, 1997"
    parameters = (EffectParameter("delay", "s", 0.0, (0.0, 0.2), 2e-3, possible=TIMES),)
    channel_errors = {"delay": (("delay", "torque_command"),)}

    def is_resolved(self, values, period):
        return values["delay"] >= TIMING_TOLERANCE * period

    def drive(self, drive, p):
        return drive.replace(time=drive.time + p["delay"])
