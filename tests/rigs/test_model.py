"""A model is a value: what is changed in it stays changed, whatever else is replaced."""

import pytest

from twin.mechanics import chain
from twin.rigs import preset
from twin.rigs.model import Model

RIG = preset("bossi2009")


@pytest.fixture
def model():
    return Model(RIG, {}, chain.fit_shape(RIG, 4))


def test_a_changed_break_away_level_survives_another_payload(model):
    worn = model.with_break_away(1.5)
    assert worn.plant.friction.static_positive == pytest.approx(0.0975)
    heavier = worn.replace(declared=RIG.replace(tip_mass=0.2))
    assert heavier.plant.friction.static_positive == pytest.approx(0.0975)


def test_set_friction_levels_survive_another_effect(model):
    firm = model.with_friction(static_positive=2.0).with_break_away(2.0)
    with_effect = firm.replace(effects={"viscous-friction": {"viscous": 1e-3}})
    assert with_effect.plant.friction.static_positive == 4.0
    assert with_effect.plant.friction.static_negative == pytest.approx(0.13)
    assert model.plant.friction.static_positive == pytest.approx(0.065)


def test_levels_never_fall_below_coulomb(model):
    assert model.with_break_away(1e-3).plant.friction.static_positive == RIG["coulomb_friction"]
