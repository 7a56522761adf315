"""Gravity that acts in a plane which is not level."""

import numpy as np
from scipy.constants import g

from twin.effects.base import Effect, EffectParameter


class GravityTilt(Effect):
    """Acceleration g sin(tilt) along `direction`, an angle fixed in the plane, on every mass of link and payload."""

    name = "gravity-tilt"
    meaning = "gravity, because the plane is not level"
    acts_on = "link"
    parameters = (
        EffectParameter("tilt", "rad", 0.0, (0.0, 0.8), 1e-3),
        EffectParameter("direction", "rad", 0.0, (-20.0, 20.0), 0.1),
    )
    along = ("direction",)

    def starts(self, rig):
        # Two components of one vector, none of which can be negative alone.
        return tuple({"tilt": 1e-3, "direction": angle} for angle in np.deg2rad([0.0, 120.0, -120.0]))

    def linear(self, p):
        return p["tilt"] * np.cos(p["direction"]), p["tilt"] * np.sin(p["direction"])

    def of_linear(self, coefficients):
        along, across = coefficients
        return {"tilt": float(np.hypot(along, across)), "direction": float(np.arctan2(across, along))}

    def plant(self, plant, p):
        pull = g * np.sin(p["tilt"])
        return plant.with_link(
            gravity_x=float(pull * np.cos(p["direction"])), gravity_y=float(pull * np.sin(p["direction"]))
        )
