"""Linear drift of the strain bridges, as of an amplifier that warms up."""

from dataclasses import replace

from twin.effects.base import Effect, EffectParameter

RATES = {"strain_base": "rate_base", "strain_mid": "rate_mid"}
"""Channel -> parameter that is its drift rate."""


class StrainDrift(Effect):
    """Reading = strain + rate t, t from the start of each recording; one rate for each bridge."""

    name = "strain-drift"
    meaning = "a drift of the strain bridges, linear in time"
    acts_on = "sensors"
    seen_as = "The reading of a resting link moves steadily from the start of a recording to its end."
    mistaken_for = {
        "gravity-tilt": "a drift goes on while the hub rests; what gravity bends depends on the angle alone",
    }
    source = "K. Hoffmann, An Introduction to Measurements using Strain Gages, 1989"
    parameters = tuple(
        EffectParameter(rate, "1/s", 0.0, (-1e-2, 1e-2), 1e-6, ch, possible=(-1.0, 1.0))
        for ch, rate in RATES.items()
    )

    def reading(self, reading, channel, p):
        if channel not in RATES:
            return reading
        rate = p[RATES[channel]]
        # `Reading` delays the drift too: rate (t - delay) + offset has to be rate t.
        return replace(reading, rate=rate, offset=rate * reading.delay)

    def sensing(self, time, channels, p):
        drifted = {ch: channels[ch] + p[rate] * time for ch, rate in RATES.items() if ch in channels}
        return {**channels, **drifted}
