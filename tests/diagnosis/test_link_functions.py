"""Faults of the link that have no name: where they act, and on what they depend."""

import pytest
from rig_campaigns import planned
from threadpoolctl import threadpool_limits

from twin.diagnosis import link_functions
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
