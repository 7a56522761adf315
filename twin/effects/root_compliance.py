"""A clamp between hub and link that gives."""

import math

from twin.effects.base import FAR, Effect, EffectParameter
from twin.mechanics import chain


class RootCompliance(Effect):
    """A spring between hub and link that takes the root's bending moment: M = stiffness * angle, without losses."""

    name = "root-compliance"
    meaning = "a clamp between hub and link that gives"
    acts_on = "link"
    parameters = (EffectParameter("stiffness", "N*m/rad", math.inf, (0.5, math.inf), 1e-3, inverse=True),)
    multiples = FAR

    def links(self, links, rig, p):
        if p["stiffness"] == math.inf:
            return links
        return chain.with_root_compliance(links, rig["hub_inertia"], p["stiffness"])
