"""A hub that is clamped at an angle other than zero: gravity in the plane bends the link according to it."""

from dataclasses import replace

import numpy as np
import pytest

from twin.campaigns.campaign import read_campaign
from twin.estimation.calibrate import noise_levels
from twin.mechanics import chain
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs.model import Model
from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import planned_campaign

TILT = {"gravity-tilt": {"tilt": 0.01, "direction": 0.5}}
GAIN = {"hub-sensor-gain": {"gain": 0.9}}
ANGLE = 1.2  # rad
MEAN_OF_NOISE = 0.2
"""Four standard errors of the mean of 10 s that are low-passed at 25 Hz: 4/sqrt(500) noise levels."""


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    """The free vibration of a clamped link on a tilted table: a model, and the recording with its hub angle."""
    plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(3))
    planned = [replace(e, start_angle=ANGLE) for e in plan if e.clamped or e.name == "break-away"]
    folder = tmp_path_factory.mktemp("clamped") / "rig"
    make_campaign(folder, TILT | GAIN, 3, experiments=planned)
    campaign = read_campaign(folder)
    [clamped] = [r for r in campaign.fit if r.clamped]
    reading = np.full(len(clamped.time), ANGLE * GAIN["hub-sensor-gain"]["gain"])
    measured = clamped.replace(channels={**clamped.channels, "hub_angle": reading})
    twin = Model(campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, 6), step=2e-3)
    return twin, [prepare(measured, noise_levels(campaign))[0]]


def mean_residual(release, effects):
    """Mean residual of the base strain [noise levels of the low-passed channel]."""
    twin, prepared = release
    model = twin.replace(effects=effects)
    residual = DrivenData.of(prepared, model).residual(model, 0, prepared[0].start)["strain_base"]
    return float(np.mean(residual))


def test_the_link_hangs_as_at_the_angle_of_the_clamp(release):
    assert abs(mean_residual(release, TILT | GAIN)) < MEAN_OF_NOISE
    elsewhere = {**TILT["gravity-tilt"], "direction": TILT["gravity-tilt"]["direction"] - ANGLE}
    assert abs(mean_residual(release, {"gravity-tilt": elsewhere} | GAIN)) > 3


def test_the_angle_of_the_clamp_is_that_behind_the_sensor(release):
    assert abs(mean_residual(release, TILT)) > MEAN_OF_NOISE
