"""Gain errors of the strain bridges."""

from twin.effects.base import GAIN_ERRORS, Effect, EffectParameter

_GAUGE_FACTOR_TOLERANCE = 5e-3
"""Relative tolerance of gauge factors in data sheets of good foil gauges: a smaller gain error is no fault."""
GAINS = {"strain_base": "gain_base", "strain_mid": "gain_mid"}
"""Channel -> parameter that is its gain."""


class StrainGain(Effect):
    """Reading = gain strain; one gain for each bridge."""

    name = "strain-gain"
    meaning = "a gain error of the strain bridges"
    acts_on = "sensors"
    seen_as = (
        "The readings of a bridge are too large or too small by the same share in every motion; hub and frequencies "
        "are right."
    )
    mistaken_for = {
        "stiffness-loss": "frequencies: a gain leaves them as they are",
    }
    source = "K. Hoffmann, An Introduction to Measurements using Strain Gages, 1989"
    parameters = tuple(
        EffectParameter(gain, "1", 1.0, (0.1, 10.0), 5e-3, ch, possible=GAIN_ERRORS)
        for ch, gain in GAINS.items()
    )
    channel_errors = {gain: (("gain", channel),) for channel, gain in GAINS.items()}

    def is_resolved(self, values, period):
        return max(abs(values[gain] - 1) for gain in GAINS.values()) >= _GAUGE_FACTOR_TOLERANCE

    def reading(self, reading, channel, p):
        return reading.scaled(p[GAINS[channel]]) if channel in GAINS else reading

    def sensing(self, time, channels, p):
        read = {ch: channels[ch] * p[gain] for ch, gain in GAINS.items() if ch in channels}
        return {**channels, **read}
