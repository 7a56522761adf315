"""Gain error of the hub angle sensor."""

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter


class HubSensorGain(Effect):
    """Reading = gain theta."""

    name = "hub-sensor-gain"
    meaning = "a gain error of the hub angle sensor"
    acts_on = "sensors"
    seen_as = "Angles are too large or too small by the same share, while strains and frequencies are right."
    mistaken_for = {
        "hub-sensor-nonlinearity": "a wide range of hub angles: the error of a gain goes on growing",
    }
    source = "a definition"
    parameters = (EffectParameter("gain", "1", 1.0, (0.1, 10.0), 5e-3, "hub_angle", possible=GAIN_ERRORS),)
    channel_errors = {"gain": (("gain", "hub_angle"),)}

    def reading(self, reading, channel, p):
        return reading.scaled(p["gain"]) if channel == "hub_angle" else reading

    def sensing(self, time, channels, p):
        if "hub_angle" not in channels:
            return channels
        return {**channels, "hub_angle": channels["hub_angle"] * p["gain"]}
