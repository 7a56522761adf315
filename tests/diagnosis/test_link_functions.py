"""Faults of the link that have no name: where they act, and on what they depend."""

from types import SimpleNamespace

import numpy as np
import pytest
from rig_campaigns import planned
from threadpoolctl import threadpool_limits

from twin import labels
from twin.diagnosis import conclude, link_functions, remainder
from twin.diagnosis.state import TIP, FunctionOf, UnnamedFunction
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool

RATE = 0.01
READS_THE_MOTOR = {"motor-in-strain": {"base": 4e-4, "mid": 0.0}}
SOFTENS = {"warming-link": {"loss": 0.08, "time_constant": 3.0}}
HITS_THE_LINK = {"loose-payload": {"share": 0.4, "gap": 4e-3}}


def likeliest(rig_campaign, effects, *experiments):
    seen = planned(7, *experiments)
    with threadpool_limits(1), ResidualPool(1) as pool:
        start = calibrate(rig_campaign(effects, 7, experiments=seen, perturb=0.5).read(), pool)
        return link_functions.functions_of(start.bench, start.base, RATE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "place", "variable"),
    [
        pytest.param(READS_THE_MOTOR, "strain_base", "torque_command"),
        pytest.param(SOFTENS, "bending_stiffness", "time", marks=pytest.mark.study),
        pytest.param(HITS_THE_LINK, "tip_force", "tip_rate", marks=pytest.mark.study),
    ],
)
def test_place_and_variable_are_found(rig_campaign, effects, place, variable):
    best, second, *_ = likeliest(rig_campaign, effects, "free-vibration", "bang-bang", "random-steps")
    assert (best.law.place, best.law.variable) == (place, variable)
    assert best.evidence > max(30.0, best.by_chance, 1.1 * second.evidence)
    assert best.lookup is None


@pytest.mark.study
def test_of_a_sound_link_no_function_is_certain(rig_campaign):
    assert likeliest(rig_campaign, {}, "free-vibration", "bang-bang", "random-steps")[0].evidence < 30.0


@pytest.mark.parametrize(
    ("evidence", "by_chance", "named"), [(100.0, 50.0, True), (100.0, 120.0, False), (25.0, -1.0, False)]
)
def test_a_function_describes_the_rest_beyond_chance_and_the_error_of_the_chain(evidence, by_chance, named):
    function = UnnamedFunction(FunctionOf("tip_rate", TIP), evidence, by_chance, *np.zeros((3, 2)))
    found = remainder.likeliest_functions(SimpleNamespace(unnamed=()), [function])
    assert found == ((function,) if named else ())


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (None, "depends on the tip rate and time"),
        (TIP, "acts like a force on the tip that depends on the tip rate and time"),
        ("strain_base", "acts like an error of the base strain that depends on the tip rate and time"),
        (
            "bending_stiffness",
            "acts like a change of the bending stiffness that depends on the tip rate and time",
        ),
    ],
)
def test_place_and_variables_in_words(place, words):
    assert labels.dependence(("tip_rate", "time"), place) == words


def functions_on_link(*evidences):
    laws = (FunctionOf("tip_rate", TIP), FunctionOf("tip_rate", "strain_base"), FunctionOf("time", TIP))
    return [UnnamedFunction(law, e, 0.0, *np.zeros((3, 2))) for law, e in zip(laws, evidences, strict=False)]


@pytest.mark.parametrize(
    ("evidences", "depends", "place"),
    [
        ((100.0, 90.0), ("tip_rate",), TIP),
        # Two places are as likely: their variable is told, and no place.
        ((100.0, 96.0), ("tip_rate",), None),
        ((100.0, 96.0), ("hub_travel", "tip_rate"), None),
        ((100.0,), ("hub_travel", "tip_rate"), None),
        ((), ("hub_angle",), None),
    ],
)
def test_a_place_is_told_where_it_is_clear_and_its_variable_comes_first(evidences, depends, place):
    likeliest_ones = remainder.likeliest_functions(SimpleNamespace(unnamed=()), functions_on_link(*evidences))
    told = conclude._acts_like(likeliest_ones, depends)
    assert (told and told.place) == place
