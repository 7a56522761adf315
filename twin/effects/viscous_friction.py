"""Friction that grows with the rate of the hub."""

from twin.effects.base import Effect, EffectParameter


class ViscousFriction(Effect):
    """f += viscous * omega: bearing grease, or the back-EMF of a voltage drive."""

    name = "viscous-friction"
    parameters = (EffectParameter("viscous", "N*m*s/rad", 0.0, (0.0, 10.0), 1e-4),)

    def plant(self, plant, p):
        return plant._replace(viscous=plant.viscous + p["viscous"])
