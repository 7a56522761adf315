"""Friction of the hub as recordings show it: static levels where rests end, both levels where it turns round."""

from dataclasses import replace

import numpy as np
import pytest

from twin.campaigns.campaign import read_campaign
from twin.diagnosis import contest
from twin.diagnosis.candidates import Candidate
from twin.estimation import static_friction
from twin.estimation.calibrate import noise_levels
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.mechanics import chain, planar
from twin.mechanics.plant import CONTACT_DAMPING
from twin.mechanics.state import Motion
from twin.residuals import hub_balance, static_levels
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID
from twin.residuals.prepared import prepare
from twin.residuals.static_levels import Level
from twin.residuals.view import Signals
from twin.rigs import preset
from twin.rigs.model import Model
from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import planned_campaign
from twin.virtual_rig.plant import CONTACT_STIFFNESS as RIG_STIFFNESS

LEVELS = {
    "static_positive": 0.0612,
    "static_negative": 0.0731,
    "coulomb_positive": 0.004,
    "coulomb_negative": 0.0105,
}


def model(rig, sensors):
    shape = chain.fit_shape(rig, 5)
    return Model(rig, sensors, shape, step=2e-3).replace(effects={"asymmetric-friction": LEVELS})


def levels_of(values):
    """Unknowns for the friction levels of each direction."""
    return [
        Unknown("effect", n, v, 0.01, False, (0.0, 0.2), effect="asymmetric-friction")
        for n, v in values.items()
    ]


@pytest.fixture(scope="module")
def ramps(tmp_path_factory):
    """A slow torque up and another down, on a rig whose friction differs by direction: the data, a model, starts."""
    folder = tmp_path_factory.mktemp("ramps") / "rig"
    plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(7))
    slow = [e for e in plan if e.name == "break-away"]
    make_campaign(folder, {"asymmetric-friction": LEVELS}, 7, experiments=slow)
    campaign = read_campaign(folder)
    twin = model(campaign.rig, campaign.sensors)
    prepared = [prepare(r, noise_levels(campaign))[0] for r in campaign.fit]
    return DrivenData.of(prepared, twin), twin, [p.start for p in prepared]


def test_static_levels_are_read_to_some_parts_in_ten_thousand(ramps):
    data, twin, starts = ramps
    off = twin.replace(effects={"asymmetric-friction": {n: 1.02 * v for n, v in LEVELS.items()}})
    found = static_levels.levels(data, off, starts)
    assert set(found) == {1, -1}
    for direction, name in ((1, "static_positive"), (-1, "static_negative")):
        assert found[direction].value == pytest.approx(LEVELS[name], rel=1.5e-3)
        assert found[direction].error < 2e-3 * LEVELS[name]


def test_a_link_that_swings_on_makes_a_static_level_less_sure(ramps, monkeypatch):
    """What the noise of a hub in motion does to the modelled link pulls at the hub that rests behind it."""
    data, twin, starts = ramps
    [view] = data.views
    first, second = [view.time[k] for k, _ in view.onsets]
    before, between = view.time < first - 0.1, (view.time > second - 0.3) & (view.time < second - 0.1)
    assert view.link_torque_noise[before].max() < 1e-9
    assert 5e-6 < view.link_torque_noise[between].min() <= view.link_torque_noise[between].max() < 5e-4
    quiet = static_levels.levels(data, twin, starts)
    monkeypatch.setattr(data, "views", (replace(view, link_torque_noise=np.full(len(view.time), 1e-3)),))
    for direction, level in static_levels.levels(data, twin, starts).items():
        assert quiet[direction].error < 2e-4
        assert level.error == pytest.approx(1e-3, rel=0.02)


@pytest.mark.slow
def test_a_play_makes_static_levels_less_sure(tmp_path):
    play = {"backlash": {"gap": 0.0146, "motor_inertia_share": 0.39}}
    plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(7))
    make_campaign(tmp_path / "rig", play, 7, experiments=[e for e in plan if e.name == "break-away"])
    campaign = read_campaign(tmp_path / "rig")
    shape = chain.fit_shape(campaign.rig, 5)
    known = {
        "backlash": {
            **play["backlash"],
            "contact_damping": CONTACT_DAMPING,
            "contact_stiffness": RIG_STIFFNESS,
        }
    }
    twin = Model(campaign.rig, campaign.sensors, shape, step=2e-3, effects=known)
    prepared = [prepare(r, noise_levels(campaign))[0] for r in campaign.fit]
    found = static_levels.levels(DrivenData.of(prepared, twin), twin, [p.start for p in prepared])
    assert found
    for level in found.values():
        assert level.value == pytest.approx(campaign.rig["static_friction"], abs=2 * level.error)
        assert level.error < 0.02 * level.value


def test_a_level_that_a_rest_tells_is_not_looked_for_by_whole_runs(ramps, monkeypatch):
    data, twin, starts = ramps
    unknowns = levels_of(LEVELS)
    with ResidualPool(1) as pool:
        bench = Workbench(data, pool)
        [residual] = bench.residuals([(twin, starts, None)])
        x = np.array(list(LEVELS.values()))
        slopes = np.zeros((len(residual), len(x)))
        size = np.ones(len(bench.groups))
        best = Fit(twin, tuple(starts), tuple(unknowns), x, np.eye(4), residual, size, 0.0, slopes)
        monkeypatch.setattr(static_friction, "costs_at", None)
        polished = static_friction.final_models(data, best, best, twin, pool, whole=True)
    told = dict(zip(LEVELS, polished.augmented.errors, strict=True))
    assert told["static_positive"] < 1e-4
    assert told["static_negative"] < 2e-4
    assert told["coulomb_positive"] == told["coulomb_negative"] == 1.0


def test_what_is_fitted_together_with_a_level_moves_with_it_when_it_is_read(ramps):
    data, twin, starts = ramps
    unknowns = levels_of(LEVELS)
    off, error = 0.004, 0.002
    x = np.array(list(LEVELS.values())) + [off, 0.0, -0.5 * off, 0.0]
    # Half a unit of Coulomb friction less for one of static friction more, and no word of the other direction.
    covariance = error**2 * np.diag([1.0, 1.0, 0.25 + 0.01, 1.0])
    covariance[0, 2] = covariance[2, 0] = -0.5 * error**2
    none = np.zeros(0)
    best = Fit(twin, tuple(starts), tuple(unknowns), x, covariance, none, none, 0.0, none)
    found = static_friction.with_static_levels(data, best)
    values, errors = (
        dict(zip(LEVELS, found.values, strict=True)),
        dict(zip(LEVELS, found.errors, strict=True)),
    )
    assert values["coulomb_positive"] == pytest.approx(LEVELS["coulomb_positive"], abs=1e-4)
    assert errors["coulomb_positive"] == pytest.approx(0.1 * error, rel=0.1)
    assert values["coulomb_negative"] == LEVELS["coulomb_negative"]
    assert errors["coulomb_negative"] == error
    assert found.model.effects["asymmetric-friction"] == values


def test_free_runs_decide_between_effects_with_the_static_levels_that_rests_tell(ramps, monkeypatch):
    data, twin, starts = ramps
    off = {**LEVELS, "static_positive": 1.2 * LEVELS["static_positive"]}
    unknowns = levels_of(off)
    x, none = np.array(list(off.values())), np.zeros(0)
    model = twin.replace(effects={"asymmetric-friction": off})
    badly_known = Fit(model, tuple(starts), tuple(unknowns), x, np.eye(4), none, none, 0.0, none)
    tried = []

    class Free:
        """Free runs that all cost alike; the models are kept."""

        count = np.ones(1)

        def __init__(self, data, pool):
            pass

        def residuals(self, jobs):
            tried.extend(model for model, _, _ in jobs)
            return [none for _ in jobs]

        def cost(self, residual):
            return 0.0

    monkeypatch.setattr(contest, "Workbench", Free)
    with ResidualPool(1) as pool:
        bench = Workbench(data, pool)
        ranked = [Candidate(("asymmetric-friction",), badly_known, score) for score in (100.0, 99.0)]
        assert contest.prefer_closer_free_runs(bench, ranked) == ranked
    assert len(tried) == 2
    for free in tried:
        level = free.effects["asymmetric-friction"]["static_positive"]
        assert level == pytest.approx(LEVELS["static_positive"], rel=1.5e-3)


def test_a_rest_that_seems_to_end_below_the_coulomb_level_tells_nothing(ramps):
    data, twin, starts = ramps
    # As if friction in motion were as large as what the rest withstood.
    heavy = {**LEVELS, "coulomb_positive": 0.09, "coulomb_negative": 0.09}
    assert static_levels.levels(data, twin.replace(effects={"asymmetric-friction": heavy}), starts) == {}


def test_a_rest_that_ends_far_below_the_others_was_none():
    read = [Level(0.065, 1e-5), Level(0.06502, 2e-5), Level(0.013, 1e-5)]
    assert static_levels.combined_level(read).value == pytest.approx(0.065, abs=1e-5)
    assert static_levels.combined_level(read[2:]).value == 0.013


def test_the_mean_of_friction_about_reversals_is_that_of_both_directions():
    rig = preset("bossi2009")
    twin = model(rig, {})
    time = GRID * np.arange(1500)
    omega = 2 * np.pi * 7.3
    angle, rate = 0.05 * np.sin(omega * time), 0.05 * omega * np.cos(omega * time)
    nothing = np.zeros(len(time))
    signals = Signals(
        time, angle, rate, -(omega**2) * angle, np.sign(rate), np.ones(len(time), dtype=bool), {}, {}, ()
    )
    links = len(twin.chain.lengths)
    angles, rates = np.outer(angle, np.ones(links)), np.outer(rate, np.ones(links))
    motion = Motion.from_coordinates(time, angles, rates, np.sign(rate), links)
    inner = slice(200, -200)
    mean = hub_balance.hub_law_torque(signals, twin, motion)[inner].mean()
    instants = np.linspace(time[200] - GRID / 2, time[-201] + GRID / 2, 200_000)
    ahead = np.cos(omega * instants) > 0
    exact = np.where(ahead, -LEVELS["coulomb_positive"], LEVELS["coulomb_negative"]).mean()
    assert mean == pytest.approx(exact, abs=1.5e-5)
    assert planar.hub_torque_along(twin.plant, time, angle, rate, nothing).max() == 0


def test_a_break_away_torque_a_little_off_is_none_that_the_hub_slides_against():
    # It would come free, stop at once, and come free again: such a run takes a thousand times as long.
    rig = preset("bossi2009").replace(static_friction=0.02, coulomb_friction=0.02)
    plain = Model(rig, {}, chain.fit_shape(rig, 5), step=2e-3)
    less, more = (plain.with_break_away(share).plant.friction for share in (0.999, 1.001))
    assert (less.static_positive, less.static_negative) == (0.02, 0.02)
    assert more.static_positive == pytest.approx(0.02002)
    assert plain.with_break_away(1.001).plant.friction.coulomb_positive == 0.02
