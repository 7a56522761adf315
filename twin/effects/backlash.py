"""Backlash between the motor and the hub."""

import math
from dataclasses import replace

import numpy as np

from twin.effects.base import Effect, EffectParameter
from twin.mechanics.plant import CONTACT_DAMPING, CONTACT_STIFFNESS

_REBOUNDING = 0.1
"""Damping ratio of a flank that rebounds with 0.74 of the speed, where one of `CONTACT_DAMPING` does with 0.45.

On a virtual bench, a fit from a ratio of 1.05 leaves 603 nat, and one from here 453 (benchmarks/results/benches.md)."""


class Backlash(Effect):
    """The motor, an inertia of motor_inertia_share times the hub's, turns freely within the total play `gap`.

    Drive torque and cogging act on the motor. Where `friction_on_motor` is 1, dry and viscous friction do too, as those
    of a gear motor with its back-EMF: a resting motor then leaves the hub free within the play. Otherwise friction acts
    on the hub, as that of its bearing. All other torques act on the hub.

    A flank in contact is a spring with a damper, both fitted: see `planar.contact_torque`.
    """

    name = "backlash"
    meaning = "play between motor and hub"
    acts_on = "drive"
    seen_as = (
        "When the torque changes its sign the hub does not follow for a moment, then is hit. The missing torque is a "
        "gap and a pulse at each reversal."
    )
    mistaken_for = {
        "dead-zone": "a dead zone depends on the command alone, play also on the path before",
        "root-compliance": "a clamp always gives, play only at reversals",
    }
    source = "M. Nordin and P.-O. Gutman, Automatica 38, 2002 (a survey of models of play)"
    parameters = (
        EffectParameter("gap", "rad", 0.0, (0.0, 0.3), 2e-3, possible=(0.0, 2 * math.pi)),
        EffectParameter("motor_inertia_share", "1", 0.4, (0.05, 0.9), 0.05, possible=(0.01, 0.99)),
        EffectParameter(
            "contact_stiffness",
            "N*m/rad",
            CONTACT_STIFFNESS,
            (10.0, 3000.0),
            2e-3,
            inverse=True,
            possible=(1.0, 1e5),
        ),
        EffectParameter("contact_damping", "1", CONTACT_DAMPING, (0.01, 2.0), 0.03, possible=(0.0, 10.0)),
        EffectParameter("friction_on_motor", "1", 0.0, (0.0, 1.0), 1.0, choice=True),
    )
    linearisable = False
    undefined_at_neutral = (
        "motor_inertia_share",
        "contact_stiffness",
        "contact_damping",
        "friction_on_motor",
    )
    # A narrow gap only delays the hub; a wide one sets it free of the motor.
    smooth_at_neutral = False
    # A wide gap with a light motor and a narrow one with a heavy motor are alike: the likelihood has a local maximum at
    # either, so several gaps are tried.
    search_multiples = tuple(np.geomspace(1, 300, 13).tolist())

    def starts(self, rig):
        own = {"gap": 2e-3, "contact_stiffness": CONTACT_STIFFNESS, "contact_damping": CONTACT_DAMPING}
        shares = (0.2, 0.3, 0.4, 0.5, 0.65)
        return tuple(
            {**own, "motor_inertia_share": share, "friction_on_motor": placed}
            for share, placed in (*((share, 1.0) for share in shares), (0.4, 0.0))
        )

    def other_minima(self, values):
        # A flank that rebounds and one that gives are alike on average, and a fit does not pass from one to the other.
        damped = values["contact_damping"] > CONTACT_DAMPING
        return ({**values, "contact_damping": _REBOUNDING},) if damped else ()

    def placed(self, torque, p):
        moved = torque.name == "viscous-friction" and p["gap"] > 0 and p.get("friction_on_motor", 0.0) == 1.0
        return replace(torque, on_motor=True) if moved else torque

    def plant(self, plant, p):
        if p["gap"] <= 0:
            return plant
        return plant.with_backlash(
            p["gap"],
            p["motor_inertia_share"] * plant.hub_inertia,
            p.get("contact_stiffness", CONTACT_STIFFNESS),
            p.get("contact_damping", CONTACT_DAMPING),
            p.get("friction_on_motor", 0.0) == 1.0,
        )
