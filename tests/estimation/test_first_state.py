"""Recordings of rigs that were already moving at the first sample."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis import candidates, remainder
from twin.diagnosis.predict import first_states, free_runs
from twin.estimation.calibrate import calibrate, noise_levels, prepare_clean
from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.residuals import static_levels
from twin.residuals.residual import EVENT_CHANNELS
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.experiments import bang_bang, break_away, free_vibration, random_steps

CABLE = {"stiffness": 0.012, "rest_angle": 0.15}


@pytest.fixture(scope="module")
def campaign(rig_campaign):
    draw = np.random.default_rng(1)
    plan = [make(Rig(), Sensors(), draw) for make in (free_vibration, random_steps)]
    return rig_campaign({}, 3, experiments=[*plan, bang_bang(Rig(), Sensors(), draw, 90.0)]).read()


def from_sample(recording, first):
    return recording.part(slice(first, None)).replace(start="unknown")


def calibrated(campaign, recordings):
    with ResidualPool(1) as pool:
        return calibrate(replace(campaign, fit=tuple(recordings)), pool)


@pytest.mark.slow
@pytest.mark.parametrize("first", [1000, 2500])
def test_they_are_followed_to_their_noise(campaign, first):
    """With the link taken for straight up to 37 noise levels were left."""
    _, steps, bang = campaign.fit
    found = calibrated(campaign, [from_sample(steps, first), bang])
    sizes = remainder.residual_sizes(found.bench, found.base)
    assert max(sizes.values()) < 1.3, sizes
    assert abs(found.base.starts[0].bend_rate[0]) > 0.05


@pytest.mark.slow
def test_a_clamped_link_that_swings(campaign):
    clamped, _, bang = campaign.fit
    found = calibrated(campaign, [from_sample(clamped, 700), bang])
    assert max(remainder.residual_sizes(found.bench, found.base).values()) < 1.3


@pytest.mark.slow
def test_without_strains_the_torque_that_the_motion_takes_tells_the_bend(campaign):
    _, steps, bang = campaign.fit
    blind = [
        r.replace(channels={"hub_angle": r["hub_angle"], "torque_command": r["torque_command"]})
        for r in (steps, bang)
    ]
    found = calibrated(campaign, [from_sample(blind[0], 2000), blind[1]])
    assert max(remainder.residual_sizes(found.bench, found.base).values()) < 1.5


def test_few_readings_in_its_first_moments(campaign):
    """Ten readings a second: none of the first state is known, and all else goes on."""
    _, steps, bang = campaign.fit
    cut = from_sample(steps, 1000)
    sparse = cut.part(slice(None, None, 50))
    found = calibrated(campaign, [sparse, bang])
    assert np.isfinite(found.base.values).all()


@pytest.mark.slow
def test_a_run_from_there_follows_as_one_from_rest_does(campaign):
    _, _, bang = campaign.fit
    found = calibrated(campaign, [bang])
    cut = from_sample(bang, 500)
    noise = noise_levels(campaign)
    with ResidualPool(1) as pool:
        for recording in (bang, cut):
            ready, _ = prepare_clean(recording, campaign.sensors, found.clock, noise)
            model = found.base.model
            run, *_ = free_runs([model], first_states([model], ready, pool), ready, pool)
            off = (run["strain_base"] - recording["strain_base"])[:500]
            assert np.sqrt(np.nanmean(off**2)) < 10 * noise["strain_base"]


@pytest.fixture(scope="module")
def with_cable(rig_campaign):
    """Two recordings that begin in motion beside one that begins with a rest."""
    draw = np.random.default_rng(1)
    plan = [make(Rig(), Sensors(), draw) for make in (random_steps, break_away)]
    plan.append(bang_bang(Rig(), Sensors(), draw, 90.0))
    campaign = rig_campaign({"cable-torsion": CABLE}, 3, experiments=plan).read()
    steps, ramps, bang = campaign.fit
    return calibrated(campaign, [from_sample(steps, 1200), ramps, from_sample(bang, 700)])


@pytest.mark.study
def test_an_effect_is_found_beside_the_first_states_of_two(with_cable):
    """The slopes of each recording's own state are kept apart: mixed up, a first fit ended far from here."""
    with ResidualPool(1) as pool:
        bench = copy(with_cable.bench)
        bench.pool = pool
        quick = candidates.try_effect(bench, with_cable.base, "cable-torsion").fit
        full = minimise(bench, quick.model, quick.starts, quick.unknowns, quick.values)
    assert full.model.effects["cable-torsion"]["stiffness"] == pytest.approx(CABLE["stiffness"], rel=0.02)
    assert quick.cost - full.cost < 0.03 * (with_cable.base.cost - full.cost)


@pytest.mark.study
def test_levels_come_from_recordings_that_begin_with_a_rest(with_cable):
    data, base = with_cable.bench.data, with_cable.base
    whole = static_levels.levels(data, base.model, base.starts)
    of_ramps = [r for r in static_levels.level_readings(data, base.model, base.starts) if r.recording == 1]
    assert whole.keys() == {r.direction for r in of_ramps}
    for direction, level in whole.items():
        assert level == static_levels.combined_level([r.level for r in of_ramps if r.direction == direction])


@pytest.mark.study
def test_what_is_told_by_an_instant_is_not_asked_of_them(with_cable):
    channels = {(g.recording, g.channel) for g in with_cable.bench.data.groups}
    assert {i for i, channel in channels if channel in EVENT_CHANNELS} == {1}
