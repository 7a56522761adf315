"""Friction levels that differ by the direction of motion."""

from twin.effects.base import Effect, EffectParameter


class AsymmetricFriction(Effect):
    """Static and Coulomb level of each direction in the place of the declared ones."""

    name = "asymmetric-friction"
    meaning = "friction that differs between the two directions"
    acts_on = "hub"
    parameters = (
        EffectParameter("static_positive", "N*m", None, (0.0, 1e3), 1e-3),
        EffectParameter("static_negative", "N*m", None, (0.0, 1e3), 1e-3),
        EffectParameter("coulomb_positive", "N*m", None, (0.0, 1e3), 1e-4),
        EffectParameter("coulomb_negative", "N*m", None, (0.0, 1e3), 1e-4),
    )
    replaces = ("static_friction", "coulomb_friction")

    def neutral(self, rig):
        return {p.name: rig[p.name.split("_")[0] + "_friction"] for p in self.parameters}

    def plant(self, plant, p):
        # A hub cannot slide against more than it withstands at rest.
        return plant.with_friction(
            coulomb_positive=p["coulomb_positive"],
            coulomb_negative=p["coulomb_negative"],
            static_positive=max(p["static_positive"], p["coulomb_positive"]),
            static_negative=max(p["static_negative"], p["coulomb_negative"]),
        )
