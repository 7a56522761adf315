"""Wires that pull the hub back."""

import math

from twin.effects.base import Effect, EffectParameter
from twin.mechanics.hub_law import HubLaw


@HubLaw
def torque(t, theta, omega, values):
    """-stiffness (theta - rest_angle)."""
    return -values[0] * (theta - values[1])


class CableTorsion(Effect):
    """Torque -stiffness * (theta - rest_angle) on the hub.

    A cable at rest more than a turn away would pull with an all but constant torque: that is no cable.
    """

    name = "cable-torsion"
    meaning = "wires that pull the hub back like a spring"
    acts_on = "hub"
    parameters = (
        EffectParameter("stiffness", "N*m/rad", 0.0, (0.0, 10.0), 1e-3),
        EffectParameter("rest_angle", "rad", 0.0, (-2 * math.pi, 2 * math.pi), 0.1),
    )

    hub_law = torque
    along = ("rest_angle",)

    def starts(self, rig):
        # The spring's two linear coefficients, stiffness and stiffness * rest_angle, need three points.
        return tuple({"stiffness": 1e-3, "rest_angle": angle} for angle in (0.0, 1.0, -1.0))

    def linear(self, p):
        return p["stiffness"], p["stiffness"] * p["rest_angle"]

    def of_linear(self, coefficients):
        stiffness, at_zero = coefficients
        return {"stiffness": stiffness, "rest_angle": at_zero / stiffness} if stiffness > 0 else None
