"""Elastic clamp between hub and link."""

import math

from twin.effects.base import FAR_MULTIPLES, Effect, EffectParameter
from twin.mechanics import chain


class RootCompliance(Effect):
    """Undamped rotary spring between hub and link: bending moment at the root M = stiffness angle."""

    name = "root-compliance"
    meaning = "an elastic clamp between hub and link"
    acts_on = "link"
    seen_as = (
        "All frequencies are lower, each by another share; the gauge at the base reads too little for the deflection "
        "of the tip."
    )
    mistaken_for = {
        "softening-stiffness": "a small and a large vibration: a clamp gives in proportion",
    }
    source = "W. Weaver, S. P. Timoshenko and D. H. Young, Vibration Problems in Engineering, 1990"
    parameters = (
        EffectParameter(
            "stiffness", "N*m/rad", math.inf, (0.5, math.inf), 1e-3, inverse=True, possible=(1e-3, math.inf)
        ),
    )
    search_multiples = FAR_MULTIPLES

    def links(self, links, rig, p):
        if p["stiffness"] == math.inf:
            return links
        return chain.with_root_compliance(links, rig["hub_inertia"], p["stiffness"])
