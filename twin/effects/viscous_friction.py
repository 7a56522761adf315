"""Viscous friction of the hub."""

from twin.effects.base import DRAG, Effect, EffectParameter
from twin.mechanics.hub_law import HubLaw


@HubLaw
def torque(t, theta, omega, values):
    """-viscous omega."""
    return -values[0] * omega


class ViscousFriction(Effect):
    """Torque -viscous omega on the hub: bearing grease, or the back-EMF of a voltage drive."""

    name = "viscous-friction"
    meaning = "friction proportional to the rate of the hub"
    acts_on = "hub"
    seen_as = (
        "The hub turns less far in fast slews, and as far as the model in slow ones. The missing torque is a straight "
        "line over the hub rate."
    )
    mistaken_for = {
        "air-pad-drag": "drag at the tip bends the link at constant speed, friction of the hub does not",
        "stribeck-friction": "Stribeck friction decreases with the rate, viscous friction increases",
    }
    source = "B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30, 1994 (a survey of friction models)"
    parameters = (EffectParameter("viscous", "N*m*s/rad", 0.0, (0.0, 10.0), 1e-4, possible=DRAG),)
    hub_law = torque
