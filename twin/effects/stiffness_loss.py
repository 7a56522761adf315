"""A link that is softer than declared everywhere."""

import numpy as np

from twin.effects.base import Effect, EffectParameter


class StiffnessLoss(Effect):
    """bending_stiffness, free of its declared uncertainty: ageing of a composite link."""

    name = "stiffness-loss"
    parameters = (EffectParameter("bending_stiffness", "N*m^2", None, (1e-6, 1e6), -2e-3),)
    replaces = ("bending_stiffness",)
    # It is told to some parts in ten thousand, and may be another one altogether.
    multiples = tuple(np.geomspace(1, 3000, 28).tolist())

    def rig(self, rig, p):
        return rig.replace(bending_stiffness=p["bending_stiffness"])
