"""The torque balance of the hub by itself, on a virtual rig whose sensors have no noise: what is left is its bias."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from twin import beam, calibration, chain, fit
from twin.campaign import read_campaign
from twin.driven import DrivenData
from twin.identify import balance, identification, joint, sentences
from twin.identify.break_away import StaticFriction
from twin.identify.results import Estimate
from twin.model import Model
from twin.rigs import preset
from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import Experiment, bang_bang

RATE = 500  # Hz
QUIET = Sensors(
    hub_noise=1e-9, strain_noise=1e-11, torque_noise=1e-8, hub_step=0, strain_step=0, torque_step=0
)
NOISE = {"hub_angle": 1e-4, "strain_base": 2e-6, "strain_mid": 2e-6, "motor_torque": 1e-3}


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep over the first two modes, seen through the true parameters: truth, model, views and first states."""
    t = np.arange(9 * RATE) / RATE
    torque = 0.15 * np.sin(2 * np.pi * (1.5 * t + 0.9 * t**2)) * np.minimum(1, t)
    folder = tmp_path_factory.mktemp("balance") / "quiet"
    sweep = Experiment("sweep", "torque-sweep", "fit", 0.0, torque)
    truth = make_campaign(folder, {}, 5, perturb=1.0, sensors=QUIET, experiments=[sweep]).true
    campaign = read_campaign(folder)
    rig = campaign.rig.replace("true", **truth)
    model = Model(rig, campaign.sensors, chain.fit_shape(rig, 5), step=2e-3)
    prepared = [fit.prepare(r, NOISE)[0] for r in campaign.fit]
    return truth, model, DrivenData(prepared, model, joint.BANDS), [p.start for p in prepared]


def test_hub_inertia_and_coulomb_friction_have_no_bias(swept):
    truth, model, data, starts = swept
    hub = balance.of_hub(data, model, starts)
    # With a link of 12 segments the inertia is 0.04 % and the friction 3.7 % high.
    assert hub.inertia.value == pytest.approx(truth["hub_inertia"], rel=1.5e-4)
    assert hub.both.value == pytest.approx(truth["coulomb_friction"], rel=2e-3)


def test_the_hub_turns_round_between_two_instants_of_the_grid(swept):
    _, model, data, starts = swept
    # A direction that is read off the grid leaves three times as much, as a torque of both signs.
    assert 1 - balance.of_hub(data, model, starts).determination < 4e-7


def test_the_friction_map_shows_a_constant_for_each_direction(swept):
    truth, model, data, starts = swept
    hub = balance.of_hub(data, model, starts)
    assert {-1.0, 1.0} == set(np.sign(hub.rate))
    # Seen through the low-pass, a hub that turns round often would have half of it or none.
    assert (hub.friction * np.sign(hub.rate)).min() > 0.8 * truth["coulomb_friction"]


def test_the_payload_from_slews_holds_the_truth(tmp_path):
    rng = np.random.default_rng(1)
    slews = [bang_bang(Rig(), Sensors(), rng, angle) for angle in (30.0, 45.0, 60.0, 75.0, 90.0, 105.0)]
    truth = make_campaign(tmp_path / "slews", {}, 1, perturb=1.0, experiments=slews).true
    campaign = read_campaign(tmp_path / "slews")
    model = Model(
        campaign.rig.replace("true", **truth), campaign.sensors, chain.fit_shape(campaign.rig, 5), step=2e-3
    )
    prepared = [fit.prepare(r, calibration.noises(campaign))[0] for r in campaign.fit]
    data, starts = DrivenData(prepared, model, joint.BANDS), [p.start for p in prepared]
    hub, whole = balance.of_hub(data, model, starts), balance.of_rig(data, model, starts)
    total = beam.rigid_inertia(model.declared)
    assert abs(whole.inertia.value - total) < 3 * whole.inertia.standard_error < 0.06 * total
    names = ("bending_stiffness", "tip_mass")
    values = np.array([truth[name] for name in names])
    found = SimpleNamespace(names=names, values=values, errors=1e-3 * values, intervals={})
    tip_mass = identification._payload(campaign.rig, found, hub, whole)
    assert abs(tip_mass.value - truth["tip_mass"]) < 3 * tip_mass.standard_error < 0.1 * truth["tip_mass"]
    none = StaticFriction((), (), {}, None, math.nan)
    methods = identification._methods(campaign.rig, found, (), none, hub, None, None, tip_mass)
    assert methods["tip_mass"]["slews"] == tip_mass
    said = sentences.inertia(hub, whole, Estimate(total, 0.01 * total), tip_mass, found).sentences
    assert any(s.startswith("Payload ") and "by (J - J0 - rho l^3/3 - J_p)/l^2" in s for s in said)


def test_the_payload_is_what_the_total_inertia_leaves():
    rig = preset("bossi2009")
    exact = {name: Estimate(rig[name], 0.0) for name in ("length", "linear_density", "tip_inertia")}
    hub = Estimate(rig["hub_inertia"], 0.0)
    total = beam.rigid_inertia(rig)
    found = balance.payload(Estimate(total, 0.01 * total), hub, exact)
    assert found.value == pytest.approx(rig["tip_mass"])
    assert found.standard_error == pytest.approx(0.01 * total / rig["length"] ** 2)
    for name in exact:
        rough = exact | {name: Estimate(rig[name], 0.02 * rig[name])}
        off = exact | {name: Estimate(1.0001 * rig[name], 0.0)}
        slope = (balance.payload(Estimate(total, 0.0), hub, off).value - rig["tip_mass"]) / 1e-4
        error = balance.payload(Estimate(total, 0.0), hub, rough).standard_error
        assert error == pytest.approx(0.02 * abs(slope), rel=1e-3), name
