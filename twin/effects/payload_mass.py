"""A payload that is not the declared one."""

from twin.effects.base import FAR, Effect, EffectParameter


class PayloadMass(Effect):
    """tip_mass, free of its declared uncertainty."""

    name = "payload-mass"
    meaning = "another payload than the declared one"
    acts_on = "payload"
    parameters = (EffectParameter("tip_mass", "kg", None, (0.0, 1e3), 1e-3),)
    replaces = ("tip_mass",)
    multiples = FAR

    def rig(self, rig, p):
        return rig.replace(tip_mass=p["tip_mass"])
