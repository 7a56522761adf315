"""A model is a value: what is changed in it stays changed, whatever else is replaced."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.mechanics import chain
from twin.rigs import preset
from twin.rigs.model import Model

RIG = preset("bossi2009")
SHAPE = chain.fit_shape(RIG, 4)


@pytest.fixture
def model():
    return Model(RIG, {}, SHAPE)


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


LEVELS = {
    "static_positive": 0.06,
    "static_negative": 0.07,
    "coulomb_positive": 0.004,
    "coulomb_negative": 0.01,
}
EFFECTS = {"asymmetric-friction": LEVELS, "payload-mass": {"tip_mass": 0.1}}
CHANGES = {
    "payload": lambda m: m.replace(declared=m.declared.replace(tip_mass=0.2)),
    "stiffness": lambda m: m.replace(declared=m.declared.replace(bending_stiffness=0.3)),
    "levels": lambda m: m.with_friction(static_positive=0.05, coulomb_negative=0.02),
    "stribeck": lambda m: m.with_friction(stribeck_velocity=0.3),
    "wear": lambda m: m.with_break_away(1.5),
    "more wear": lambda m: m.with_break_away(0.8),
    "effects": lambda m: m.replace(effects=EFFECTS),
    "step": lambda m: m.replace(step=5e-4),
}


def numbers(value):
    """All numbers of nested tuples of numbers and arrays."""
    return [x for part in value for x in numbers(part)] if isinstance(value, tuple) else [*np.ravel(value)]


@settings(max_examples=40)
@given(data=st.data(), names=st.lists(st.sampled_from(sorted(CHANGES)), min_size=2, unique=True))
def test_changes_give_the_same_model_in_every_order(data, names):
    first = second = Model(RIG, {}, SHAPE)
    for name in names:
        first = CHANGES[name](first)
        assert first.plant.friction.static_positive > 0  # computed in between, and not to be kept by the next
    for name in data.draw(st.permutations(names)):
        second = CHANGES[name](second)
    assert first.rig.parameters == second.rig.parameters
    assert first.step == second.step
    for part in ("link", "friction", "motor"):
        assert numbers(getattr(first.plant, part)) == numbers(getattr(second.plant, part))
