"""A potentiometer that reads too much or too little."""

from twin.effects.base import Effect, EffectParameter


class HubSensorGain(Effect):
    """reading = gain * theta."""

    name = "hub-sensor-gain"
    meaning = "an angle sensor with another gain than declared"
    acts_on = "sensors"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 5e-3, "hub_angle"),)

    def reading(self, reading, channel, p):
        return reading.scaled(p["gain"]) if channel == "hub_angle" else reading

    def sensing(self, time, channels, p):
        if "hub_angle" not in channels:
            return channels
        return {**channels, "hub_angle": channels["hub_angle"] * p["gain"]}
