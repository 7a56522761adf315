"""Strain bridges that drift: an amplifier that warms up."""

from twin.effects.base import Effect, EffectParameter

RATES = {"strain_base": "rate_base", "strain_mid": "rate_mid"}
"""Channel -> parameter with the rate of its drift."""


class StrainDrift(Effect):
    """reading = strain + rate t, a rate for each bridge, t from the start of each recording."""

    name = "strain-drift"
    parameters = tuple(
        EffectParameter(rate, "1/s", 0.0, (-1e-2, 1e-2), 1e-6, ch) for ch, rate in RATES.items()
    )

    def sensing(self, time, channels, p):
        drifted = {ch: channels[ch] + p[rate] * time for ch, rate in RATES.items() if ch in channels}
        return {**channels, **drifted}
