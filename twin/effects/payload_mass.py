"""A payload that is not the declared one."""

import numpy as np

from twin.effects.base import Effect, EffectParameter


class PayloadMass(Effect):
    """tip_mass, free of its declared uncertainty."""

    name = "payload-mass"
    parameters = (EffectParameter("tip_mass", "kg", None, (0.0, 1e3), 1e-3),)
    replaces = ("tip_mass",)
    # It is told to some parts in ten thousand, and may be another one altogether.
    multiples = tuple(np.geomspace(1, 3000, 28).tolist())

    def rig(self, rig, p):
        return rig.replace(tip_mass=p["tip_mass"])
