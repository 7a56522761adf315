"""The backlash: on which side of it the torques act, and where its fit may be trapped."""

import pytest

from twin.effects import REGISTRY
from twin.mechanics import chain
from twin.rigs import bossi2009
from twin.rigs.model import Model

RIG = bossi2009.reconciled()


@pytest.mark.parametrize(("choice", "on_motor"), [({}, False), ({"friction_on_motor": 1.0}, True)])
def test_friction_acts_on_the_side_that_is_chosen(choice, on_motor):
    effects = {
        "viscous-friction": {"viscous": 0.01},
        "cable-torsion": {"stiffness": 0.01, "rest_angle": 0.0},
        "backlash": {"gap": 0.01, "motor_inertia_share": 0.4, **choice},
    }
    model = Model(RIG, {}, chain.fit_shape(RIG, 4), effects)
    sides = {torque.name: torque.on_motor for torque in model.hub_torques}
    assert sides == {"viscous-friction": on_motor, "cable-torsion": False}
    assert model.plant.rubs_on_motor == on_motor


def test_a_fit_with_damped_flanks_is_repeated_with_flanks_that_rebound():
    damped = {"gap": 0.03, "motor_inertia_share": 0.4, "contact_stiffness": 800.0, "contact_damping": 1.2}
    [other] = REGISTRY["backlash"].other_minima(damped)
    assert other == {**damped, "contact_damping": 0.1}
    assert REGISTRY["backlash"].other_minima(other) == ()
