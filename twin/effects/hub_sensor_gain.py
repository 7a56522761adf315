"""Gain error of the hub angle sensor."""

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter


class HubSensorGain(Effect):
    """Reading = gain theta."""

    name = "hub-sensor-gain"
    meaning = "a gain error of the hub angle sensor"
    acts_on = "sensors"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 5e-3, "hub_angle", possible=GAIN_ERRORS),)

    def reading(self, reading, channel, p):
        return reading.scaled(p["gain"]) if channel == "hub_angle" else reading

    def sensing(self, time, channels, p):
        if "hub_angle" not in channels:
            return channels
        return {**channels, "hub_angle": channels["hub_angle"] * p["gain"]}
