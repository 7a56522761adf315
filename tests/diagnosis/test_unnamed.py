"""A torque on the hub without a name: how much likelier a smooth function makes what is left."""

from dataclasses import replace

import numpy as np
import pytest
from rig_campaigns import planned
from scipy.stats import multivariate_normal

from twin.diagnosis import state, unnamed
from twin.estimation.calibrate import calibrate
from twin.estimation.gaussian_process import AMPLITUDES, LENGTH_SCALES, maximise_evidence, posterior_mean
from twin.estimation.residual_pool import ResidualPool


def test_evidence_is_that_of_a_gaussian_process():
    random = np.random.default_rng(1)
    columns = random.normal(size=(60, 12))
    planted = np.sin(np.linspace(0, 3, 12))
    data = columns @ planted + random.normal(size=60)
    information = columns.T @ columns
    found = maximise_evidence(information, -columns.T @ data, np.zeros((0, 12)))
    place = np.linspace(0, 1, 12)
    alone = np.median(np.diag(information)) ** -0.5
    nothing = multivariate_normal(cov=np.eye(60)).logpdf(data)
    best = -np.inf
    for length in LENGTH_SCALES:
        likeness = np.exp(-0.5 * ((place[:, None] - place) / length) ** 2) + 1e-6 * np.eye(12)
        for size in alone * AMPLITUDES:
            covariance = np.eye(60) + size**2 * columns @ likeness @ columns.T
            best = max(best, multivariate_normal(cov=covariance).logpdf(data) - nothing)
    assert found.value == pytest.approx(best, rel=1e-6)
    curve = posterior_mean(information, -columns.T @ data, found.length, found.size)
    np.testing.assert_allclose(curve, planted, atol=0.5)
    assert np.corrcoef(curve, planted)[0, 1] > 0.95


def test_noise_asks_for_no_function():
    random = np.random.default_rng(2)
    columns = random.normal(size=(200, 12))
    draws = random.normal(size=(500, 200)) @ columns
    found = maximise_evidence(columns.T @ columns, draws[0], draws[1:])
    # A function that is nearly zero costs nearly nothing; chance seldom does better.
    assert np.median(found.by_draw) < 0.5
    assert np.mean(found.by_draw > 5.0) < 0.01


def asked(rig_campaign, effects, torque_sensor=False):
    """The functions sought in what calibration leaves of a sweep and some steps."""
    seen = planned(5, "torque-sweep", "random-steps")
    return asked_of(
        rig_campaign(effects, 5, experiments=seen, perturb=0.5, motor_torque=torque_sensor).read()
    )


def asked_of(campaign):
    with ResidualPool(1) as pool:
        start = calibrate(campaign, pool)
        return unnamed.find_functions(start.bench, start.base, 0.01)


@pytest.mark.slow
def test_a_dead_band_is_a_function_of_the_command(rig_campaign):
    [best, *others] = asked(rig_campaign, {"dead-band": {"width": 0.025}})
    assert best.law.variables == ("torque_command",)
    assert best.evidence > max(5.0, best.by_chance)
    assert all(other.evidence < 5.0 for other in others)
    # Within the zone the command is taken away; how much of it, the filter and the rig's own parameters leave open.
    lookup = best.lookup
    assert lookup.at(np.array([0.015])) < -5e-4
    assert lookup.at(np.array([-0.015])) > 5e-4


@pytest.mark.study
def test_a_sensor_of_the_torque_reads_a_dead_band_too(rig_campaign):
    best, *others = asked(rig_campaign, {"dead-band": {"width": 0.02}}, torque_sensor=True)
    on_hub = next(n for n in others if n.law == state.FunctionOf("torque_command"))
    assert best.law == state.FunctionOf("torque_command", state.DRIVE)
    assert best.evidence > max(5.0, best.by_chance, 2 * on_hub.evidence)
    lookup = best.lookup
    assert lookup.at(np.array([0.012])) < -5e-4
    assert lookup.at(np.array([-0.012])) > 5e-4


@pytest.mark.slow
@pytest.mark.parametrize("torque_sensor", [False, True])
def test_nothing_is_asked_for_where_nothing_is_missing(rig_campaign, torque_sensor):
    assert asked(rig_campaign, {}, torque_sensor)[0].evidence < 1.0


@pytest.mark.slow
def test_of_a_hub_that_is_clamped_nothing_is_asked(rig_campaign):
    campaign = rig_campaign({}, 5, experiments=planned(5, "free-vibration", "random-steps")).read()
    clamped = tuple(r for r in campaign.fit if r.clamped)
    assert len(clamped) == 1
    assert asked_of(replace(campaign, fit=clamped)) == ()
