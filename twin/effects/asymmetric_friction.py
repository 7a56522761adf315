"""Friction levels that depend on the direction of rotation."""

from twin.effects.base import TORQUES, Effect, EffectParameter


class AsymmetricFriction(Effect):
    """Static and Coulomb friction level of each direction of rotation, in place of the declared ones."""

    name = "asymmetric-friction"
    meaning = "friction levels that differ between the two directions of rotation"
    acts_on = "hub"
    seen_as = (
        "The same torque to either side turns the hub by different angles, and the hub breaks away at different "
        "torques. The missing torque is a constant for each direction."
    )
    mistaken_for = {
        "torque-bias": (
            "a bias shifts both levels by the same amount, and also acts on a hub that is at rest; break-aways to both "
            "sides show the levels"
        ),
    }
    source = "B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30, 1994 (a survey of friction models)"
    parameters = (
        EffectParameter("static_positive", "N*m", None, (0.0, 1e3), 1e-3, possible=TORQUES),
        EffectParameter("static_negative", "N*m", None, (0.0, 1e3), 1e-3, possible=TORQUES),
        EffectParameter("coulomb_positive", "N*m", None, (0.0, 1e3), 1e-4, possible=TORQUES),
        EffectParameter("coulomb_negative", "N*m", None, (0.0, 1e3), 1e-4, possible=TORQUES),
    )
    replaces = ("static_friction", "coulomb_friction")

    def neutral(self, rig):
        return {p.name: rig[p.name.split("_")[0] + "_friction"] for p in self.parameters}

    def plant(self, plant, p):
        # The static level is at least the Coulomb level.
        return plant.with_friction(
            coulomb_positive=p["coulomb_positive"],
            coulomb_negative=p["coulomb_negative"],
            static_positive=max(p["static_positive"], p["coulomb_positive"]),
            static_negative=max(p["static_negative"], p["coulomb_negative"]),
        )
