"""Stribeck effect: sliding friction that decreases with speed."""

from twin.effects.base import Effect, EffectParameter


class StribeckFriction(Effect):
    """Sliding friction level coulomb + (static - coulomb) exp(-(omega/stribeck_velocity)^2)."""

    name = "stribeck-friction"
    meaning = "sliding friction that decreases with speed from the static to the Coulomb level"
    acts_on = "hub"
    seen_as = (
        "After a start and before a stop the hub is braked more than the model says, at speed as much. The missing "
        "torque has the sign of the rate and fades above `stribeck_velocity`."
    )
    mistaken_for = {
        "asymmetric-friction": "slow motion in both directions",
    }
    source = "B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30, 1994 (a survey of friction models)"
    parameters = (EffectParameter("stribeck_velocity", "rad/s", 0.0, (0.0, 20.0), 0.1, possible=(0.0, 1e3)),)

    def starts(self, rig):
        return tuple({"stribeck_velocity": v} for v in (0.05, 0.3, 1.5))

    def plant(self, plant, p):
        return plant.with_friction(stribeck_velocity=p["stribeck_velocity"])
