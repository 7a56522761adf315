"""A link whose bending moment grows less than linearly with its curvature."""

from twin.effects.base import Effect, EffectParameter


class SofteningStiffness(Effect):
    """M = EI kappa (1 - softening kappa^2/(kappa^2 + curvature^2)): Bossi et al. 2009, Fig. 3, moves that way."""

    name = "softening-stiffness"
    meaning = "a link that gets softer the more it bends"
    acts_on = "link"
    parameters = (
        EffectParameter("softening", "1", 0.0, (0.0, 0.95), 0.01),
        EffectParameter("curvature", "1/m", 1.0, (0.02, 20.0), 0.05),
    )
    along = ("curvature",)

    def starts(self, rig):
        return tuple({"softening": 0.01, "curvature": kappa} for kappa in (0.2, 0.6, 2.0))

    def plant(self, plant, p):
        return plant.with_link(softening=p["softening"], softening_curvature=p["curvature"])
