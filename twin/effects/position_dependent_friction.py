"""Friction that is periodic in the hub angle: an eccentric bearing."""

from twin.effects.base import ANGLES, ORDERS, TORQUES, Effect, EffectParameter
from twin.effects.wave import Wave


class PositionDependentFriction(Effect):
    """Static and Coulomb level raised by amplitude (1 + sin(order theta + phase))/2."""

    name = "position-dependent-friction"
    meaning = "friction levels that are periodic in the hub angle"
    acts_on = "hub"
    seen_as = (
        "Where the hub comes to rest depends on where it started. The missing torque has the sign of the rate, and its "
        "size repeats with the hub angle."
    )
    mistaken_for = {
        "cogging": "cogging pushes in the same direction whichever way the hub turns; a slow turn to and fro tells",
    }
    source = "B. Armstrong-Hélouvry, Control of Machines with Friction, 1991"
    parameters = (
        EffectParameter("amplitude", "N*m", 0.0, (0.0, 1.0), 1e-3, possible=TORQUES),
        EffectParameter("order", "1", 1.0, (0.9, 80.0), 0.02, possible=ORDERS),
        EffectParameter("phase", "rad", 0.0, (-20.0, 20.0), 0.1, possible=ANGLES),
    )
    undefined_at_neutral = ("order", "phase")
    wave = Wave("friction", "order")

    def plant(self, plant, p):
        return plant.with_friction(amplitude=p["amplitude"], order=p["order"], phase=p["phase"])
