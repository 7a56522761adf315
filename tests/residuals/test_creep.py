"""How a hub leaves a rest, and friction that falls with the speed: what recordings tell of it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.campaigns.campaign import read_campaign
from twin.estimation.calibrate import noise_levels
from twin.mechanics import chain, planar
from twin.mechanics.plant import declared_plant
from twin.mechanics.state import Motion
from twin.residuals import creep, hub_balance, stribeck_reversals
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, REACH, low_passed, smooth_spline
from twin.residuals.prepared import prepare
from twin.residuals.rest_run import SAMPLES_BEFORE_ONSET, RestRun
from twin.residuals.view import Signals, move_link
from twin.rigs import preset
from twin.rigs.model import Model
from twin.virtual_rig import Rig, Sensors, campaign_writer, make_campaign
from twin.virtual_rig.experiments import Experiment, planned_campaign

VELOCITY = 0.25  # rad/s
CHANNELS = ("hub_angle", "strain_base", "strain_mid", "motor_torque")


def ramps(folder, effects, seed, slow=None, sensors=None):
    """A slow torque up and another down, or other experiments: the data, and a model with the rig's own parameters."""
    plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(seed))
    slow = slow or [e for e in plan if e.name == "break-away"]
    make_campaign(folder, effects, seed, experiments=slow, sensors=sensors)
    campaign = read_campaign(folder)
    twin = Model(campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, 5), step=2e-3)
    return DrivenData.of([prepare(r, noise_levels(campaign))[0] for r in campaign.fit], twin), twin


@pytest.fixture(scope="module")
def falling(tmp_path_factory):
    effects = {"stribeck-friction": {"stribeck_velocity": VELOCITY}}
    return ramps(tmp_path_factory.mktemp("falling") / "rig", effects, 7)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return ramps(tmp_path_factory.mktemp("plain") / "rig", {}, 7)


def misfit(data, model):
    """Root mean square of the readings about break-aways [noise levels]."""
    parts = np.concatenate(
        [data.residual(model, i, p.start)["departure"] for i, p in enumerate(data.prepared)]
    )
    return float(np.sqrt(np.mean(parts**2)))


def with_velocity(model, value):
    return model.replace(effects={"stribeck-friction": {"stribeck_velocity": value}})


def test_runs_of_the_right_friction_leave_the_noise(falling, plain):
    assert misfit(plain[0], plain[1]) < 1.2
    assert misfit(falling[0], with_velocity(falling[1], VELOCITY)) < 1.2


def test_a_hub_creeps_before_it_visibly_moves(tmp_path, monkeypatch):
    """It breaks away 80 ms before its readings show it; without noise, so that only rounding is left."""
    monkeypatch.setattr(
        campaign_writer, "noise_of", lambda _, samples, __: dict.fromkeys(CHANNELS, np.zeros(samples))
    )
    time = np.arange(3000) / 500
    ramp = Experiment("ramp", "ramp", "fit", 0.3, 0.02 * np.minimum(time, 4.0))
    effects = {"stribeck-friction": {"stribeck_velocity": VELOCITY}}
    data, twin = ramps(tmp_path / "rig", effects, 7, [ramp], Sensors(hub_step=1e-9))
    assert misfit(data, with_velocity(twin, VELOCITY)) < 0.04


@pytest.mark.parametrize("velocity", [0.0, 0.6])
def test_runs_of_another_friction_do_not(falling, velocity):
    data, twin = falling
    assert misfit(data, with_velocity(twin, velocity)) > 1.5 * misfit(data, with_velocity(twin, VELOCITY))


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_the_static_level_is_left_open(plain, part):
    data, twin = plain
    level = part * twin.plant.friction.static_positive
    other = twin.with_friction(static_positive=level, static_negative=level)
    assert misfit(data, other) == pytest.approx(misfit(data, twin), rel=1e-3)


def test_how_strongly_the_hub_is_pushed_is_left_open(plain):
    data, twin = plain
    pushed = twin.replace(effects={"torque-bias": {"bias": 2e-3}})
    assert misfit(data, pushed) == pytest.approx(misfit(data, twin), rel=0.03)


def test_readings_are_a_group_of_their_own(plain):
    data, twin = plain
    groups = [g for g in data.groups if g.channel == "departure"]
    assert [g.recording for g in groups] == [0]
    counts = [n for g, n in zip(data.blocks, data.counts(), strict=True) if g.channel == "departure"]
    assert sum(counts) == data.views[0].departing.sum()


def test_a_model_that_never_comes_free_is_a_hub_at_rest(plain):
    data, twin = plain
    # Friction in motion beyond any torque, and an inertia at which nothing is stable.
    heavy = twin.with_friction(coulomb_positive=1.5, coulomb_negative=1.5)
    assert 10 < misfit(data, heavy) < np.inf
    wild = twin.replace(effects={"viscous-friction": {"viscous": 1e6}})
    assert 10 < misfit(data, wild) < np.inf


def test_a_missing_reading_about_a_break_away_is_not_compared(plain):
    data, twin = plain
    [prepared], [view] = data.prepared, data.views
    onset, _ = view.departures[0]
    hub = prepared.recording["hub_angle"].copy()
    hub[[onset - 20, onset + 10]] = np.nan
    holed = prepared.recording.replace(channels={**prepared.recording.channels, "hub_angle": hub})
    again = DrivenData.of([prepare(holed, prepared.noise)[0]], twin)
    assert again.views[0].departing.sum() == view.departing.sum() - 2
    assert misfit(again, twin) < 1.2


def test_a_jump_of_the_command_is_no_slow_torque(plain):
    data, twin = plain
    [prepared], [view] = data.prepared, data.views
    motion, _ = move_link(view, prepared, twin, prepared.start)
    onset, direction = view.departures[0]
    run = RestRun.of(twin, prepared, motion, onset, direction)
    assert run.is_slow
    command = prepared.recording["torque_command"].copy()
    command[onset - 1 :] *= 1.5
    jumped = prepared.recording.replace(channels={**prepared.recording.channels, "torque_command": command})
    again = RestRun.of(
        twin, prepared.__class__(**{**vars(prepared), "recording": jumped}), motion, onset, direction
    )
    assert not again.is_slow


def test_a_rest_of_one_reading_tells_no_static_level(plain):
    data, twin = plain
    [prepared], [view] = data.prepared, data.views
    motion, _ = move_link(view, prepared, twin, prepared.start)
    onset, direction = view.departures[0]
    hub = prepared.recording["hub_angle"].copy()
    hub[onset - 400 : onset - SAMPLES_BEFORE_ONSET] = np.nan
    holed = prepared.recording.replace(channels={**prepared.recording.channels, "hub_angle": hub})
    of_one = prepared.__class__(**{**vars(prepared), "recording": holed})
    assert RestRun.of(twin, of_one, motion, onset, direction) is None


def test_samples_that_share_an_instant_have_the_noise_of_one(plain):
    data, twin = plain
    [prepared], [view] = data.prepared, data.views
    motion, _ = move_link(view, prepared, twin, prepared.start)
    fine, _ = creep.departure_residual(view.time, prepared, twin, motion, view.departures)
    coarse, there = creep.departure_residual(view.time[::5], prepared, twin, motion, view.departures)
    assert there.sum() < 0.3 * view.departing.sum()
    assert (coarse**2).sum() < (fine**2).sum()
    assert np.std(coarse[there]) == pytest.approx(1.0, abs=0.4)


def test_a_closed_play_is_a_hub_with_its_motor():
    rig = preset("bossi2009")
    plant = declared_plant(rig, chain.build(rig, 5))
    shut = plant.with_backlash(0.02, 1e-4).with_backlash_closed()
    assert shut.motor.gap == 0
    np.testing.assert_allclose(shut.link.inertia, plant.link.inertia)
    assert plant.with_backlash_closed() is plant


def test_the_mean_of_a_falling_friction_over_a_step_is_its_integral():
    rig = preset("bossi2009")
    plant = declared_plant(rig, chain.build(rig, 5)).with_friction(stribeck_velocity=0.2)
    rate, acceleration = np.linspace(-2, 2, 81), np.full(81, 150.0)
    found = planar.mean_friction(plant, 0 * rate, rate, acceleration * GRID)
    within = rate[:, None] + acceleration[:, None] * GRID * (np.arange(4000) + 0.5 - 2000) / 4000
    fallen = (plant.friction.static_positive - plant.friction.coulomb_positive) * np.exp(
        -((within / 0.2) ** 2)
    )
    exact = -(np.sign(within) * (plant.friction.coulomb_positive + fallen)).mean(axis=1)
    np.testing.assert_allclose(found, exact, atol=1e-3 * plant.friction.static_positive)


def test_the_mean_of_friction_at_a_steady_rate_is_its_level():
    rig = preset("bossi2009")
    plant = declared_plant(rig, chain.build(rig, 5)).with_friction(
        coulomb_positive=0.004, coulomb_negative=0.0105, amplitude=0.002
    )
    rate = np.array([-1.0, 0.0, 0.5, -1.0, 0.5])
    change = np.array([0.0, 0.0, 0.0, 1e-3, 1e-3])
    expected = np.array([0.0115, 0.0, -0.005, 0.0115, -0.005])
    np.testing.assert_allclose(planar.mean_friction(plant, 0 * rate, rate, change), expected, rtol=1e-9)


def test_what_the_filter_takes_from_a_hub_that_turns_round_is_put_back(monkeypatch):
    rig = preset("bossi2009")
    twin = Model(rig, {}, chain.fit_shape(rig, 5), step=2e-3).with_friction(stribeck_velocity=0.8)
    plant, inertia = twin.plant, twin.chain.free_hub_inertia()
    fine, finer = np.arange(0, 2, 2e-4), 10
    torque = 1.6 * plant.friction.static_positive * np.sin(2 * np.pi * 4 * fine + 0.3)

    def friction(rate):
        fallen = (plant.friction.static_positive - plant.friction.coulomb_positive) * np.exp(
            -((rate / 0.8) ** 2)
        )
        return -np.tanh(rate / 1e-3) * (plant.friction.coulomb_positive + fallen)

    def move(t, x):
        return [x[1], (np.interp(t, fine, torque) + friction(x[1])) / inertia]

    angle, rate = solve_ivp(move, (0, 2), [0.0, 0.0], "LSODA", fine, max_step=1e-4, rtol=1e-8).y
    exact = low_passed(low_passed(friction(rate), 2e-4, 70.0), 2e-4)[::finer]
    time = fine[::finer]
    spline = smooth_spline(time, low_passed(angle[::finer], GRID, 70.0))
    seen = spline(time), spline(time, 1), spline(time, 2)
    signals = Signals(time, *seen, np.sign(seen[1]), np.ones(len(time), dtype=bool), {}, {}, ())
    links = len(twin.chain.lengths)
    angles, rates = (np.outer(v, np.ones(links)) for v in seen[:2])
    motion = Motion.from_coordinates(time, angles, rates, np.sign(seen[1]), links)

    def error():
        return np.std((low_passed(hub_balance.hub_law_torque(signals, twin, motion), GRID) - exact)[100:-100])

    put_back = error()
    monkeypatch.setattr(stribeck_reversals, "FIXED_POINT_STEPS", 1)
    once = error()
    monkeypatch.setattr(stribeck_reversals, "FIXED_POINT_STEPS", 0)
    assert put_back < 0.5 * once < 0.5 * error()
    assert put_back < 0.03 * np.std(exact)


def test_what_friction_seems_to_do_where_a_rest_ends_does_not_turn_a_creeping_hub_round():
    rig = preset("bossi2009")
    twin = Model(rig, {}, chain.fit_shape(rig, 5), step=2e-3).with_friction(stribeck_velocity=1.2)
    time = GRID * np.arange(1000)
    rate = np.where(time < 1.0, 0.0, 0.03 * (time - 1.0))
    angle, nothing = np.cumsum(rate) * GRID, np.zeros(len(time))
    surely = time > 1.0 + REACH
    signals = Signals(time, angle, rate, nothing, np.sign(rate), surely, {}, {}, ())
    links = len(twin.chain.lengths)
    angles, rates = (np.outer(v, np.ones(links)) for v in (angle, rate))
    found = hub_balance.hub_law_torque(
        signals, twin, Motion.from_coordinates(time, angles, rates, np.sign(rate), links)
    )
    level = planar.sliding_level(twin.plant, 0.0, 0.015, 1)
    np.testing.assert_allclose(found[surely & (time < 1.9)], -level, rtol=0.01)
