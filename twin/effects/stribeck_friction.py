"""Friction that falls smoothly from the break-away to the Coulomb level."""

from twin.effects.base import Effect, EffectParameter


class StribeckFriction(Effect):
    """Sliding level coulomb + (static - coulomb) exp(-(omega/stribeck_velocity)^2)."""

    name = "stribeck-friction"
    meaning = "friction that falls smoothly from break-away to Coulomb level"
    acts_on = "hub"
    parameters = (EffectParameter("stribeck_velocity", "rad/s", 0.0, (0.0, 20.0), 0.1),)

    def starts(self, rig):
        return tuple({"stribeck_velocity": v} for v in (0.05, 0.3, 1.5))

    def plant(self, plant, p):
        return plant.with_friction(stribeck_velocity=p["stribeck_velocity"])
