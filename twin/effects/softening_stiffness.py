"""Bending stiffness that decreases with curvature."""

from twin.effects.base import Effect, EffectParameter


class SofteningStiffness(Effect):
    """Bending moment M = EI kappa (1 - softening kappa^2/(kappa^2 + curvature^2)), kappa the curvature.

    The resonances of Bossi et al. 2009, Fig. 3, decrease with growing amplitude, as with this law.
    """

    name = "softening-stiffness"
    meaning = "a bending stiffness that decreases with curvature"
    acts_on = "link"
    seen_as = (
        "The frequency of a large vibration is lower than that of a small one. The residual grows faster than the "
        "deflection."
    )
    mistaken_for = {
        "air-drag": "drag damps large vibrations, and hardly changes their frequency",
    }
    source = "Bossi et al. 2009, Fig. 3, shows the effect; the form of the law is assumed"
    parameters = (
        EffectParameter("softening", "1", 0.0, (0.0, 0.95), 0.01, possible=(0.0, 0.99)),
        EffectParameter("curvature", "1/m", 1.0, (0.02, 20.0), 0.05, possible=(1e-3, 1e3)),
    )
    undefined_at_neutral = ("curvature",)

    def starts(self, rig):
        return tuple({"softening": 0.01, "curvature": kappa} for kappa in (0.2, 0.6, 2.0))

    def plant(self, plant, p):
        return plant.with_link(softening=p["softening"], softening_curvature=p["curvature"])
