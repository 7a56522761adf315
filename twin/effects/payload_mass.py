"""A payload mass outside its declared uncertainty."""

from twin.effects.base import FAR_MULTIPLES, Effect, EffectParameter
from twin.parameters import PARAMETERS


class PayloadMass(Effect):
    """tip_mass without the prior of its declared uncertainty."""

    name = "payload-mass"
    meaning = "a payload mass other than the declared one"
    acts_on = "payload"
    seen_as = (
        "All frequencies of the link are lower (heavier) or higher, and slews less or more far. With the hub locked "
        "the first frequency is off most."
    )
    mistaken_for = {
        "stiffness-loss": (
            "two frequencies, hub free and locked: mass and stiffness move them in different proportion; or a static "
            "test"
        ),
    }
    source = "a definition"
    parameters = (
        EffectParameter("tip_mass", "kg", None, (0.0, 1e3), 1e-3, possible=PARAMETERS["tip_mass"][1]),
    )
    replaces = ("tip_mass",)
    search_multiples = FAR_MULTIPLES

    def rig(self, rig, p):
        return rig.replace(tip_mass=p["tip_mass"])
