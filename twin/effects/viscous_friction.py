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
    parameters = (EffectParameter("viscous", "N*m*s/rad", 0.0, (0.0, 10.0), 1e-4, possible=DRAG),)
    hub_law = torque
