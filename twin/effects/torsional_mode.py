"""A lightly damped oscillator on the hub, such as torsion of the link: near 28 Hz in Bossi et al. 2009, Fig. 4."""

from dataclasses import replace

import numpy as np

from twin.effects.base import TORSION, Effect, EffectParameter
from twin.effects.wave import RESONANCE_DAMPING, Wave

TWIST_PARAMETERS = {"strain_base": "strain_base", "strain_mid": "strain_mid"}
"""Channel -> parameter that is its sensitivity to the twist."""


class TorsionalMode(Effect):
    """J psi'' + c psi' + k psi = -J theta'', J = inertia_share hub_inertia; bridges read strain_base psi,
    strain_mid psi on top.

    psi [rad] is the angle against the hub, k = J (2 pi frequency)^2, c = 2 damping_ratio J 2 pi frequency. The total
    inertia of the hub stays as declared.
    """

    name = "torsional-mode"
    meaning = "a lightly damped extra mode of the link"
    acts_on = "link"
    seen_as = (
        "A peak in the spectrum of gauges and torque balance at a frequency at which the beam has no mode; it rings on "
        "after fast edges."
    )
    mistaken_for = {
        "root-compliance": "a clamp that gives moves the modes that exist, and adds none",
    }
    source = "Bossi et al. 2009, Fig. 4, shows a peak near 28 Hz"
    parameters = (
        EffectParameter("frequency", "Hz", 28.0, (4.0, 80.0), 0.05, possible=(0.1, 1e4)),
        EffectParameter("damping_ratio", "1", 0.02, (5e-4, 0.4), 2e-3, possible=(0.0, 1.0)),
        EffectParameter("inertia_share", "1", 0.0, (0.0, 0.85), 0.01, possible=(0.0, 0.99)),
        *(
            EffectParameter(name, "1/rad", 0.0, (-1.0, 1.0), 1e-4, ch, possible=(-1e3, 1e3))
            for ch, name in TWIST_PARAMETERS.items()
        ),
    )
    undefined_at_neutral = ("frequency", "damping_ratio")

    wave = Wave("resonance", "frequency")

    def wave_parameters(self, order, coefficients):
        share, *sensitivities = coefficients
        start = {"frequency": order, "damping_ratio": RESONANCE_DAMPING, "inertia_share": max(share, 1e-3)}
        return {**start, **dict(zip(TWIST_PARAMETERS.values(), sensitivities, strict=True))}

    def plant(self, plant, p):
        if p["inertia_share"] <= 0:
            return plant
        # `hub_inertia`, not the diagonal of the mass matrix, which includes the first segment.
        inertia = p["inertia_share"] * plant.hub_inertia
        omega = 2 * np.pi * p["frequency"]
        return plant.with_torsion(inertia, inertia * omega**2, 2 * p["damping_ratio"] * omega * inertia)

    def reading(self, reading, channel, p):
        if channel not in TWIST_PARAMETERS or p["inertia_share"] <= 0:
            return reading
        return replace(reading, twist=p[TWIST_PARAMETERS[channel]])

    def sensing(self, time, channels, p):
        if TORSION not in channels:
            return channels
        twist = channels[TORSION]
        read = {ch: channels[ch] + p[name] * twist for ch, name in TWIST_PARAMETERS.items() if ch in channels}
        return {**channels, **read}
