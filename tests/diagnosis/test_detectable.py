"""What recordings can show: standard errors are those of the augmented normal equations, and scale with the noise."""

import math

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, HELD_OUT, HUB, toml_text, write

from twin.campaigns.campaign import read_campaign
from twin.diagnosis import detectable
from twin.diagnosis.rays import point_on_ray, rays, visible_length, with_effect
from twin.effects import REGISTRY
from twin.estimation.calibrate import declared_fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.slopes import prior_precision, row_weights

RECORDINGS = (FIT, HELD_OUT)


@pytest.fixture
def made(tmp_path):
    """Returns a function that gives data and declared model of a small campaign with these channels."""
    pools = []

    def make(channels=CHANNELS):
        pools.append(ResidualPool(1))
        folder = tmp_path / str(len(pools))
        folder.mkdir()
        return declared_fit(read_campaign(write(folder, toml_text(channels, RECORDINGS))), pools[-1])

    yield make
    for pool in pools:
        pool.shutdown()


def sizes(made, name):
    return {d.parameter: d for d in detectable.sizes(*made, name)}


def test_a_standard_error_is_that_of_the_effect_beside_all_declared_parameters(made):
    bench, base = made()
    bias = 1e-4
    [moved] = bench.residuals([(with_effect(base.model, "torque-bias", {"bias": bias}), base.starts, None)])
    J = np.column_stack([base.jacobian, (moved - base.residual) / bias])
    weights = row_weights(bench, np.zeros(len(moved)))
    information = J.T @ (weights[:, None] * J) + np.diag(np.r_[prior_precision(base.unknowns), 0.0])
    expected = math.sqrt(np.linalg.inv(information)[-1, -1])
    found = sizes((bench, base), "torque-bias")["bias"]
    assert found.sigma == pytest.approx(expected, rel=1e-3)
    assert 7 * found.sigma < found.found < 20 * found.sigma


def test_more_noise_shows_less(made):
    loud = {**CHANNELS, "hub_angle": HUB.replace("1e-4", "1e-3")}
    quiet, worse = (sizes(made(c), "viscous-friction")["viscous"] for c in (CHANNELS, loud))
    assert worse.sigma > 3 * quiet.sigma
    assert worse.found > 3 * quiet.found


def test_a_gain_of_a_gauge_shows_where_it_is_recorded_and_not_below_what_good_bridges_are_off(made):
    assert [*sizes(made(), "strain-gain")] == ["gain_base"]
    precise = {**CHANNELS, "strain_base": GAUGE.replace("1e-6", "1e-8")}
    assert abs(sizes(made(precise), "strain-gain")["gain_base"].found - 1) >= 0.005


def test_an_infinite_neutral_value_has_a_found_value_and_no_standard_error(made):
    found = sizes(made(), "root-compliance")["stiffness"]
    assert found.neutral == math.inf
    assert found.sigma == math.inf
    assert math.isnan(found.found) or 0 < found.found < math.inf


def test_a_coupled_effect_has_one_size_that_of_the_least_visible_direction(made):
    assert [*sizes(made(), "torsional-mode")] == ["inertia_share"]
    assert [*sizes(made(), "cable-torsion")] == ["stiffness"]


def test_a_parameter_with_a_ray_of_its_own_is_not_judged_by_one_that_moves_others_too(made):
    # Sliding shows the Coulomb level; the static one acts at rest, where the driven link shows no torque of the hub.
    found = sizes(made(), "asymmetric-friction")
    assert not found["static_positive"].is_visible
    assert found["coulomb_positive"].sigma < found["static_positive"].sigma


def test_a_change_of_the_residual_is_that_of_the_length_it_is_told_for(made):
    """Also where no length changes it by one noise level: a standard error is the length over the change."""
    bench, base = made()
    for name, effect in REGISTRY.items():
        if effect.wave is not None:
            continue
        neutral = effect.neutral(base.model.declared)
        for ray in rays(bench, effect, neutral, base.model):
            length, change = visible_length(bench, base, name, neutral, ray, 15.0)
            if change is None:
                continue
            ahead = point_on_ray(effect, neutral, ray, length)
            point, sign = (ahead, 1) if ahead else (point_on_ray(effect, neutral, ray, -length), -1)
            [moved] = bench.residuals([(with_effect(base.model, name, point), base.starts, None)])
            np.testing.assert_array_equal(sign * (moved - base.residual), change, err_msg=name)
