"""A link of another stiffness than declared everywhere, mostly softer."""

from twin.effects.base import FAR, Effect, EffectParameter


class StiffnessLoss(Effect):
    """bending_stiffness, free of its declared uncertainty: ageing of a composite link."""

    name = "stiffness-loss"
    meaning = "a link that is softer than declared all along, or stiffer"
    acts_on = "link"
    parameters = (EffectParameter("bending_stiffness", "N*m^2", None, (1e-6, 1e6), -2e-3),)
    replaces = ("bending_stiffness",)
    multiples = FAR

    def rig(self, rig, p):
        return rig.replace(bending_stiffness=p["bending_stiffness"])
