"""Play between the motor and the hub."""

import numpy as np

from twin import planar
from twin.effects.base import Effect, EffectParameter


class Backlash(Effect):
    """The motor turns by `gap` in all before it drives the hub; it has a share of the hub's inertia.

    Its torque and its magnets act on the motor, friction and everything else on the hub. Stiffness and loss of the
    flanks are assumed: `planar.CONTACT_STIFFNESS`, `planar.CONTACT_LOSS`.
    """

    name = "backlash"
    parameters = (
        EffectParameter("gap", "rad", 0.0, (0.0, 0.3), 2e-3),
        EffectParameter("motor_inertia_share", "1", 0.4, (0.05, 0.9), 0.05),
    )
    along = ("motor_inertia_share",)
    # A wide gap with a light motor does much what a narrow one with a heavy motor does: a fit settles in either.
    multiples = tuple(np.geomspace(1, 300, 13).tolist())

    def starts(self, rig):
        return tuple({"gap": 2e-3, "motor_inertia_share": share} for share in (0.2, 0.3, 0.4, 0.5, 0.65))

    def plant(self, plant, p):
        if p["gap"] <= 0:
            return plant
        return planar.with_backlash(plant, p["gap"], p["motor_inertia_share"] * plant.hub_inertia)
