"""Values that no rig can have are refused, and no value that a search may arrive at is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from planted import PLANTED

from twin.control import plants
from twin.effects import REGISTRY, EffectParameter
from twin.errors import InputError
from twin.rigs import preset
from twin.rigs.rig_file import checked_effects, effect_lines, header_lines, parameter_lines, read_rig_file

RIG = preset("bossi2009")
PARAMETERS = [(name, p) for name, effect in REGISTRY.items() for p in effect.parameters]
IDS = [f"{name}-{p.name}" for name, p in PARAMETERS]


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
def test_a_search_stays_within_what_is_possible(name, parameter):
    low, high = parameter.possible_range
    assert low <= parameter.bounds[0] <= parameter.bounds[1] <= high
    assert low <= REGISTRY[name].neutral(RIG)[parameter.name] <= high


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
@pytest.mark.parametrize("wrong", [math.nan, -math.inf, -1e15, "0.1", True, None, [1.0]])
def test_what_no_rig_can_have_is_refused(name, parameter, wrong):
    with pytest.raises(InputError, match=rf"effects\.{name}\.{parameter.name} is .*; expected "):
        checked_effects({name: {parameter.name: wrong}}, RIG)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("actuator-lag", {"time_constant": -5}),
        ("sensor-delay", {"delay": -5}),
        ("sensor-delay", {"delay": 3600}),
        ("sensor-delay", {"strain": 0.5}),
        ("payload-mass", {"tip_mass": -5}),
        ("root-compliance", {"stiffness": -1e9}),
        ("root-compliance", {"stiffness": 0}),
        ("backlash", {"gap": -5}),
        ("backlash", {"motor_inertia_share": 1}),
        ("torque-gain", {"gain": 0}),
        ("gravity-tilt", {"tilt": 90}),
        ("stiffness-loss", {"bending_stiffness": 0}),
        ("softening-stiffness", {"softening": 1}),
    ],
)
def test_examples_of_each_sort(name, values):
    with pytest.raises(InputError, match=f"effects.{name}"):
        checked_effects({name: values}, RIG)


@pytest.mark.parametrize("name", REGISTRY)
@pytest.mark.parametrize("end", [0, 1])
def test_what_a_search_may_arrive_at_is_read_back(name, end, tmp_path):
    effect = REGISTRY[name]
    values = {p.name: p.bounds[end] for p in effect.parameters}
    lines = [*header_lines("found", "with an effect")]
    for parameter in RIG.parameters.values():
        lines += parameter_lines(parameter, 1e150)
    lines += effect_lines(name, values, dict.fromkeys(values, math.inf), {}, "found")
    (tmp_path / "rig.toml").write_text("\n".join(lines))
    assert read_rig_file(tmp_path / "rig.toml")[1] == {name: values}


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
@pytest.mark.parametrize("end", [0, 1])
def test_a_simulation_at_the_end_of_a_range_is_finite_or_refused(name, parameter, end):
    value = (parameter.bounds if parameter.choice else parameter.possible_range)[end]
    acting = {name: {**PLANTED[name], parameter.name: value}}
    try:
        plant = plants.make_plant("compiled", RIG, acting, segments=3)
    except InputError:
        return
    with np.errstate(all="ignore"):
        for torque in (0.0, 0.1, 0.1, -0.1):
            plant.advance(torque)
    readings = [*plant.configuration, *plant.read().values()]
    # A rig that torques of 1000 N m turn too fast is one of which a run says that it diverged.
    assert np.all(np.isfinite(readings)) or not np.all(np.isfinite(plant.configuration))


def test_an_effect_of_another_package_keeps_the_sign_of_its_range():
    positive = EffectParameter("level", "N*m", 0.5, (0.1, 2.0), 0.1)
    assert positive.possible_range == (0.0, 1e12)
    assert replace(positive, bounds=(-2.0, 2.0)).possible_range == (-1e12, 1e12)
    assert replace(positive, bounds=(0.1, math.inf)).possible_range == (0.0, math.inf)
    with pytest.raises(InputError, match="level is -0.1 N"):
        positive.checked("level", -0.1)


def test_a_range_of_a_search_beyond_what_is_possible_is_refused():
    with pytest.raises(ValueError, match="level has the bounds"):
        EffectParameter("level", "N*m", 0.0, (0.0, 2.0), 0.1, possible=(0.0, 1.0))
