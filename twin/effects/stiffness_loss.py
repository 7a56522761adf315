"""A bending stiffness of the whole link outside its declared uncertainty."""

from twin.effects.base import FAR_MULTIPLES, Effect, EffectParameter
from twin.parameters import PARAMETERS


class StiffnessLoss(Effect):
    """bending_stiffness without the prior of its declared uncertainty: ageing of a composite link."""

    name = "stiffness-loss"
    meaning = "a bending stiffness of the whole link other than the declared one"
    acts_on = "link"
    seen_as = (
        "All frequencies of the link are lower by the same share, and static deflections larger; where the hub ends "
        "hardly changes."
    )
    mistaken_for = {
        "softening-stiffness": "small and large vibrations: a loss is the same in both",
        "root-compliance": "a gauge beside the deflection of the tip: a clamp that gives moves the tip without strain",
    }
    source = "a definition; fibre composites lose stiffness with age"
    parameters = (
        EffectParameter(
            "bending_stiffness",
            "N*m^2",
            None,
            (1e-6, 1e6),
            -2e-3,
            possible=PARAMETERS["bending_stiffness"][1],
        ),
    )
    replaces = ("bending_stiffness",)
    search_multiples = FAR_MULTIPLES

    def rig(self, rig, p):
        return rig.replace(bending_stiffness=p["bending_stiffness"])
