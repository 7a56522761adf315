"""Gravity in the plane of motion of a rig that is not level."""

import math

import numpy as np
from scipy.constants import g

from twin.effects.base import ANGLES, Effect, EffectParameter


class GravityTilt(Effect):
    """Gravity g sin(tilt) on all masses of link and payload, along the angle `direction` fixed in the plane."""

    name = "gravity-tilt"
    meaning = "gravity in the plane of motion, which is not level"
    acts_on = "link"
    seen_as = (
        "The resting link is bent, differently at different hub angles, and the hub is pulled towards the lowest point "
        "of the table. The missing torque is a sine of the hub angle with one period a turn."
    )
    mistaken_for = {
        "cogging": "cogging does not bend the resting link",
        "position-dependent-friction": "gravity pulls a resting hub too, friction only brakes",
    }
    source = "statics of a rigid body in the field of gravity"
    parameters = (
        EffectParameter("tilt", "rad", 0.0, (0.0, 0.8), 1e-3, possible=(0.0, math.pi / 2)),
        EffectParameter("direction", "rad", 0.0, (-20.0, 20.0), 0.1, possible=ANGLES),
    )
    undefined_at_neutral = ("direction",)

    def starts(self, rig):
        # Three directions determine both components of the vector; its length, the tilt, is not negative.
        return tuple({"tilt": 1e-3, "direction": angle} for angle in np.deg2rad([0.0, 120.0, -120.0]))

    def linear_coefficients(self, p):
        return p["tilt"] * np.cos(p["direction"]), p["tilt"] * np.sin(p["direction"])

    def from_linear_coefficients(self, coefficients):
        along, across = coefficients
        return {"tilt": float(np.hypot(along, across)), "direction": float(np.arctan2(across, along))}

    def plant(self, plant, p):
        pull = g * np.sin(p["tilt"])
        return plant.with_link(
            gravity_x=float(pull * np.cos(p["direction"])), gravity_y=float(pull * np.sin(p["direction"]))
        )
