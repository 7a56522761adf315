"""A linear spring on the hub: the torsional stiffness of its wires."""

import math

from twin.effects.base import ANGLES, Effect, EffectParameter
from twin.mechanics.hub_law import HubLaw


@HubLaw
def torque(t, theta, omega, values):
    """-stiffness (theta - rest_angle)."""
    return -values[0] * (theta - values[1])


class CableTorsion(Effect):
    """Torque -stiffness (theta - rest_angle) on the hub.

    The rest angle is limited to one turn: with one farther away the torque is nearly constant, as a `torque-bias`.
    """

    name = "cable-torsion"
    meaning = "wires that pull the hub back like a spring"
    acts_on = "hub"
    seen_as = (
        "The hub turns too far towards one angle and too little away from it, and creeps back when the motor is off. "
        "The missing torque is a straight line over the hub angle."
    )
    mistaken_for = {
        "cogging": "a wide range of hub angles: the line goes on, the wave returns",
        "gravity-tilt": "a wide range of hub angles; gravity also bends the resting link",
        "torque-bias": "hub angles far apart: the spring's torque changes, a bias does not",
    }
    source = "Hooke's law; that wires obey it is assumed"
    parameters = (
        EffectParameter("stiffness", "N*m/rad", 0.0, (0.0, 10.0), 1e-3, possible=(0.0, 1e4)),
        EffectParameter("rest_angle", "rad", 0.0, (-2 * math.pi, 2 * math.pi), 0.1, possible=ANGLES),
    )

    hub_law = torque
    undefined_at_neutral = ("rest_angle",)

    def starts(self, rig):
        # Three points determine the two linear coefficients, stiffness and stiffness * rest_angle.
        return tuple({"stiffness": 1e-3, "rest_angle": angle} for angle in (0.0, 1.0, -1.0))

    def linear_coefficients(self, p):
        return p["stiffness"], p["stiffness"] * p["rest_angle"]

    def from_linear_coefficients(self, coefficients):
        stiffness, at_zero = coefficients
        return {"stiffness": stiffness, "rest_angle": at_zero / stiffness} if stiffness > 0 else None
