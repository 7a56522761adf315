"""The total inertia and the payload by the angular momentum of the whole rig, on slews of virtual rigs."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rig_campaigns import NOISE, QUIET

from twin.estimation.calibrate import noise_levels
from twin.identification import balance, findings, joint, parameter_estimates, total_inertia
from twin.identification.break_away import StaticFriction
from twin.identification.estimates import Estimate
from twin.mechanics import beam, chain
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.experiments import bang_bang

ANGLES = (30.0, 45.0, 60.0, 75.0, 90.0, 105.0)  # degrees


def slewed(rig_campaign, seed, sensors=None, noise=None):
    """Six slews there and back, seen through the true parameters: truth, rig as declared, model and views."""
    generator = np.random.default_rng(seed)
    slews = [bang_bang(Rig(), Sensors(), generator, angle) for angle in ANGLES]
    made = rig_campaign({}, seed, perturb=1.0, sensors=sensors, experiments=slews)
    truth, campaign = made.truth.true, made.read()
    true = campaign.rig.replace("true", **truth)
    model = Model(true, campaign.sensors, chain.fit_shape(true, 5), step=2e-3)
    noise = noise or noise_levels(campaign)
    prepared = [prepare(recording, noise)[0] for recording in campaign.fit]
    return truth, campaign.rig, model, DrivenData.of(prepared, model, joint.BANDS)


@pytest.fixture(scope="module")
def quiet(rig_campaign):
    return slewed(rig_campaign, 5, QUIET, NOISE)


@pytest.fixture(scope="module")
def noisy(rig_campaign):
    return slewed(rig_campaign, 1)


def test_a_bent_link_is_nearer_to_the_axis():
    # A load at the tip, w'' = c (1 - s/l), puts it at y = c l^2/3 and x = l - c^2 l^3/15: r^2 = l^2 - c^2 l^4/45.
    c, rate, m, positions = 0.3, 2.0, 5, (0.02, 0.21)
    rig = {"length": 0.42, "linear_density": 0.0, "tip_mass": 0.155}
    bends = [np.full(m, c * (1 - x / rig["length"])) for x in positions]
    found = total_inertia.foreshortening_momentum(
        bends, positions, 0.002 * np.arange(m), np.full(m, rate), rig
    )
    assert found == pytest.approx(-0.155 * rate * c**2 * 0.42**4 / 45, rel=5e-3)


@pytest.mark.slow
def test_the_total_inertia_has_no_bias(quiet):
    _, _, model, data = quiet
    found = total_inertia.momentum_balance(data, model).inertia
    # Taken as straight, a link that bends by 65 mm makes it 0.4 to 1 % low.
    assert found.value == pytest.approx(beam.rigid_inertia(model.declared), rel=5e-4)


@pytest.mark.slow
def test_a_strain_that_is_bridged_is_no_reading(quiet):
    _, _, model, data = quiet
    prepared = []
    for p in data.prepared:
        mid = p.recording["strain_mid"].copy()
        fastest = int(np.argmax(np.abs(np.gradient(p.recording["hub_angle"]))))
        mid[fastest : fastest + 75] = np.nan  # 0.15 s
        channels = {**p.recording.channels, "strain_mid": mid}
        prepared.append(prepare(p.recording.replace(channels=channels), NOISE)[0])
    found = total_inertia.momentum_balance(DrivenData.of(prepared, model, joint.BANDS), model)
    assert found.inertia.value == pytest.approx(beam.rigid_inertia(model.declared), rel=5e-3)


@pytest.mark.slow
def test_the_shape_of_the_link_needs_two_gauges(quiet):
    _, _, model, data = quiet
    one = replace(model, sensors={n: s for n, s in model.sensors.items() if n != "strain_mid"})
    assert total_inertia.momentum_balance(data, one) is None


@pytest.mark.slow
def test_few_runs_say_nothing(quiet):
    _, _, model, data = quiet
    assert total_inertia.momentum_balance(DrivenData.of(data.prepared[:2], model, joint.BANDS), model) is None


@pytest.mark.slow
def test_total_inertia_and_payload_from_slews_hold_the_truth(noisy):
    truth, declared, model, data = noisy
    hub = balance.hub_balance(data, model, [p.start for p in data.prepared])
    whole = total_inertia.momentum_balance(data, model)
    total = beam.rigid_inertia(model.declared)
    low, high = whole.inertia.interval
    assert low < total < high
    assert high - low < 0.008 * total
    names = ("bending_stiffness", "tip_mass")
    values = np.array([truth[name] for name in names])
    fitted = {n: Estimate(float(v), 1e-3 * float(v)) for n, v in zip(names, values, strict=True)}
    found = SimpleNamespace(names=names, values=values, errors=1e-3 * values, estimate=fitted.__getitem__)
    results = SimpleNamespace(
        static_test=None,
        joint=found,
        decays=(),
        static_friction=StaticFriction((), (), {}, None, math.nan),
        hub_balance=hub,
        momentum=whole,
        friction_map=None,
    )
    tip_mass = parameter_estimates.tip_mass_by_balances(declared, results)
    low, high = tip_mass.interval
    assert low < truth["tip_mass"] < high
    assert high - low < 0.025 * truth["tip_mass"]
    methods = parameter_estimates.estimates_by_procedure(declared, results)
    assert methods["tip_mass"]["slews"] == tip_mass
    said = findings.inertia(hub, whole, Estimate(total, 0.01 * total), tip_mass, found).sentences
    assert any(s.startswith("Payload ") and "by the total inertia less that of the hub" in s for s in said)


def test_the_payload_is_what_the_total_inertia_leaves():
    rig = preset("bossi2009")
    exact = {name: Estimate(rig[name], 0.0) for name in ("length", "linear_density", "tip_inertia")}
    hub = Estimate(rig["hub_inertia"], 0.0)
    total = beam.rigid_inertia(rig)
    found = balance.tip_mass_from_inertias(Estimate(total, 0.01 * total), hub, exact)
    assert found.value == pytest.approx(rig["tip_mass"])
    assert found.standard_error == pytest.approx(0.01 * total / rig["length"] ** 2)
    assert found.interval[1] - found.value == pytest.approx(1.96 * found.standard_error)
    wide = balance.tip_mass_from_inertias(
        Estimate(total, 0.01 * total, (0.97 * total, 1.03 * total)), hub, exact
    )
    assert wide.interval[1] - wide.value == pytest.approx(3 * found.standard_error)
    for name in exact:
        rough = exact | {name: Estimate(rig[name], 0.02 * rig[name])}
        off = exact | {name: Estimate(1.0001 * rig[name], 0.0)}
        slope = (
            balance.tip_mass_from_inertias(Estimate(total, 0.0), hub, off).value - rig["tip_mass"]
        ) / 1e-4
        error = balance.tip_mass_from_inertias(Estimate(total, 0.0), hub, rough).standard_error
        assert error == pytest.approx(0.02 * abs(slope), rel=1e-3), name
