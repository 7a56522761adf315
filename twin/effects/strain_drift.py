"""Strain bridges that drift: an amplifier that warms up."""

from dataclasses import replace

from twin.effects.base import Effect, EffectParameter

RATES = {"strain_base": "rate_base", "strain_mid": "rate_mid"}
"""Channel -> parameter with the rate of its drift."""


class StrainDrift(Effect):
    """reading = strain + rate t, a rate for each bridge, t from the start of each recording."""

    name = "strain-drift"
    meaning = "strain bridges that drift in time"
    acts_on = "sensors"
    parameters = tuple(
        EffectParameter(rate, "1/s", 0.0, (-1e-2, 1e-2), 1e-6, ch) for ch, rate in RATES.items()
    )

    def reading(self, reading, channel, p):
        if channel not in RATES:
            return reading
        rate = p[RATES[channel]]
        # The drift itself is not late, and the sensor's delay holds all of the reading back.
        return replace(reading, rate=rate, offset=rate * reading.delay)

    def sensing(self, time, channels, p):
        drifted = {ch: channels[ch] + p[rate] * time for ch, rate in RATES.items() if ch in channels}
        return {**channels, **drifted}
