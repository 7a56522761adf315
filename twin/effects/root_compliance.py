"""Elastic clamp between hub and link."""

import math

from twin.effects.base import FAR_MULTIPLES, Effect, EffectParameter
from twin.mechanics import chain


class RootCompliance(Effect):
    """Undamped rotary spring between hub and link: bending moment at the root M = stiffness angle."""

    name = "root-compliance"
    meaning = "an elastic clamp between hub and link"
    acts_on = "link"
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
