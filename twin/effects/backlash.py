"""Play between the motor and the hub."""

import numpy as np

from twin.effects.base import Effect, EffectParameter
from twin.mechanics.plant import CONTACT_LOSS


class Backlash(Effect):
    """The motor turns by `gap` in all before it drives the hub; it has a share of the hub's inertia.

    Its torque and its magnets act on the motor, friction and everything else on the hub. The stiffness of the flanks is
    assumed, `CONTACT_STIFFNESS`: half or twice of it moves a gap by about its standard error. What they lose
    moves it by several and is seen in how often the motor comes back from them: `contact_loss` is fitted.
    """

    name = "backlash"
    meaning = "play between motor and hub"
    acts_on = "drive"
    parameters = (
        EffectParameter("gap", "rad", 0.0, (0.0, 0.3), 2e-3),
        EffectParameter("motor_inertia_share", "1", 0.4, (0.05, 0.9), 0.05),
        EffectParameter("contact_loss", "1", CONTACT_LOSS, (0.02, 0.8), 0.03),
    )
    linearisable = False
    along = ("motor_inertia_share", "contact_loss")
    # A wide gap with a light motor does much what a narrow one with a heavy motor does: a fit settles in either.
    multiples = tuple(np.geomspace(1, 300, 13).tolist())

    def starts(self, rig):
        own = {"gap": 2e-3, "contact_loss": CONTACT_LOSS}
        return tuple({**own, "motor_inertia_share": share} for share in (0.2, 0.3, 0.4, 0.5, 0.65))

    def plant(self, plant, p):
        if p["gap"] <= 0:
            return plant
        loss = p.get("contact_loss", CONTACT_LOSS)
        return plant.with_backlash(p["gap"], p["motor_inertia_share"] * plant.hub_inertia, loss)
