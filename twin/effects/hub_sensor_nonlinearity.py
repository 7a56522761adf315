"""Periodic error of the hub angle sensor: the track of a potentiometer, the eccentricity of an encoder disc."""

import math
from dataclasses import replace

import numpy as np

from twin.effects.base import ANGLES, ORDERS, Effect, EffectParameter
from twin.effects.wave import Wave


class HubSensorNonlinearity(Effect):
    """Reading = theta + amplitude sin(order theta + phase)."""

    name = "hub-sensor-nonlinearity"
    meaning = "an error of the hub angle sensor, periodic in the angle"
    acts_on = "sensors"
    seen_as = (
        "The hub seems to speed up and slow down at the same angles in each direction, while the gauges show no force. "
        "The error is a wave over the hub angle."
    )
    mistaken_for = {
        "position-dependent-friction": "the gauges: friction bends the link, a sensor's error does not",
    }
    source = "eccentric discs of encoders and tracks of potentiometers; the sine is assumed"
    parameters = (
        EffectParameter("amplitude", "rad", 0.0, (0.0, 0.5), 1e-3, "hub_angle", possible=(0.0, 2 * math.pi)),
        EffectParameter("order", "1", 1.0, (0.9, 40.0), 0.02, "hub_angle", possible=ORDERS),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1, "hub_angle", possible=ANGLES),
    )
    undefined_at_neutral = ("order", "phase")
    wave = Wave("reading", "order")

    def reading(self, reading, channel, p):
        if channel != "hub_angle":
            return reading
        return replace(reading, amplitude=p["amplitude"], order=p["order"], phase=p["phase"])

    def sensing(self, time, channels, p):
        if "hub_angle" not in channels:
            return channels
        theta = channels["hub_angle"]
        return {**channels, "hub_angle": theta + p["amplitude"] * np.sin(p["order"] * theta + p["phase"])}
