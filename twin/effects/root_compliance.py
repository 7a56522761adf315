"""A clamp between hub and link that gives."""

import math

import numpy as np

from twin import chain
from twin.effects.base import Effect, EffectParameter


class RootCompliance(Effect):
    """A spring between hub and link that takes the root's bending moment: M = stiffness * angle, without losses."""

    name = "root-compliance"
    parameters = (EffectParameter("stiffness", "N*m/rad", math.inf, (0.5, math.inf), 1e-3, inverse=True),)
    # A clamp nearly as soft as the link makes it ring so far off that no fit from a small size finds the way.
    multiples = tuple(np.geomspace(1, 3000, 28).tolist())

    def links(self, links, rig, p):
        if p["stiffness"] == math.inf:
            return links
        return chain.with_root(links, rig["hub_inertia"], p["stiffness"])
