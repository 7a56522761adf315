"""Strain bridges that read too much or too little."""

from twin.effects.base import Effect, EffectParameter

_SOLD = 5e-3
"""Relative tolerance of gauge factors, as data sheets of good foil gauges have it: less is no fault of a bridge."""
GAINS = {"strain_base": "gain_base", "strain_mid": "gain_mid"}
"""Channel -> parameter with its gain."""


class StrainGain(Effect):
    """reading = gain * strain, a gain for each bridge."""

    name = "strain-gain"
    meaning = "strain bridges with another gain than declared"
    acts_on = "sensors"
    parameters = tuple(EffectParameter(gain, "1", 1.0, (0.1, 10.0), 5e-3, ch) for ch, gain in GAINS.items())

    def resolved(self, values, period):
        return max(abs(values[gain] - 1) for gain in GAINS.values()) >= _SOLD

    def reading(self, reading, channel, p):
        return reading.scaled(p[GAINS[channel]]) if channel in GAINS else reading

    def sensing(self, time, channels, p):
        read = {ch: channels[ch] * p[gain] for ch, gain in GAINS.items() if ch in channels}
        return {**channels, **read}
