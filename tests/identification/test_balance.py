"""The torque balance of the hub by itself, on a virtual rig whose sensors have no noise: what is left is its bias."""

from __future__ import annotations

import numpy as np
import pytest
from rig_campaigns import NOISE, QUIET

from twin.identification import balance, joint
from twin.mechanics import chain
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs.model import Model
from twin.virtual_rig.experiments import Experiment

RATE = 500  # Hz


@pytest.fixture(scope="module")
def swept(rig_campaign):
    """A sweep over the first two modes, seen through the true parameters: truth, model, views and first states."""
    t = np.arange(9 * RATE) / RATE
    torque = 0.15 * np.sin(2 * np.pi * (1.5 * t + 0.9 * t**2)) * np.minimum(1, t)
    sweep = Experiment("sweep", "torque-sweep", "fit", 0.0, torque)
    made = rig_campaign({}, 5, perturb=1.0, sensors=QUIET, experiments=[sweep])
    truth, campaign = made.truth.true, made.read()
    rig = campaign.rig.replace("true", **truth)
    model = Model(rig, campaign.sensors, chain.fit_shape(rig, 5), step=2e-3)
    prepared = [prepare(r, NOISE)[0] for r in campaign.fit]
    return truth, model, DrivenData.of(prepared, model, joint.BANDS), [p.start for p in prepared]


def test_hub_inertia_and_coulomb_friction_have_no_bias(swept):
    truth, model, data, starts = swept
    hub = balance.hub_balance(data, model, starts)
    # With a link of 12 segments the inertia is 0.04 % and the friction 3.7 % high.
    assert hub.inertia.value == pytest.approx(truth["hub_inertia"], rel=1.5e-4)
    assert hub.coulomb_mean.value == pytest.approx(truth["coulomb_friction"], rel=2e-3)


def test_the_hub_turns_round_between_two_instants_of_the_grid(swept):
    _, model, data, starts = swept
    # A direction that is read off the grid leaves three times as much, as a torque of both signs.
    assert 1 - balance.hub_balance(data, model, starts).determination < 4e-7


def test_the_friction_map_shows_a_constant_for_each_direction(swept):
    truth, model, data, starts = swept
    hub = balance.hub_balance(data, model, starts)
    assert {-1.0, 1.0} == set(np.sign(hub.rate))
    # Seen through the low-pass, a hub that turns round often would have half of it or none.
    assert (hub.friction * np.sign(hub.rate)).min() > 0.8 * truth["coulomb_friction"]
