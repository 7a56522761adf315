"""Sensors that all report late: from rest, what they show is what a drive that is late shows."""

import numpy as np
import pytest
from rig_campaigns import planned

from twin.estimation.calibrate import noise_levels
from twin.mechanics import chain
from twin.recording import HUB_TORQUE
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.residuals.residual import scaled_change
from twin.rigs.model import Model


@pytest.fixture(scope="module")
def recorded(rig_campaign):
    """A slew from rest to rest as residuals, and the declared model."""
    slews = planned(4400, "bang-bang", "free-vibration")
    campaign = rig_campaign({"viscous-friction": {"viscous": 0.004}}, 4400, experiments=slews).read()
    [slew, *_] = [r for r in campaign.fit if r.name.startswith("bang-bang")]
    prepared, _ = prepare(slew, noise_levels(campaign))
    model = Model(campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, 5), step=2e-3)
    return DrivenData.of([prepared], model), model


def late_sensors(model, delay):
    return model.replace(
        effects={"sensor-delay": {"delay": delay, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}}
    )


@pytest.mark.parametrize("delay", [0.005, 0.0188])
def test_readings_that_are_late_and_a_drive_that_is_late_leave_the_same(recorded, delay):
    data, model = recorded
    start = data.prepared[0].start
    drive = data.residual(model.replace(effects={"actuator-delay": {"delay": delay}}), 0, start)
    sensors = data.residual(late_sensors(model, delay), 0, start)
    time = data.views[0].time
    for group in [g for g in data.groups if g.channel in (HUB_TORQUE, "strain_base")]:
        name = group.channel
        assert np.std(drive[name]) > 0.5
        off = (sensors[name] - drive[name])[time[group.instants] < 0.9 * time[-1]]
        assert np.sqrt(np.mean(off**2)) < 0.2, name


def test_a_change_of_the_torque_is_seen_as_late_as_the_torque(recorded):
    data, model = recorded
    view = data.views[0]
    wave = 0.01 * np.sin(4 * np.pi * view.time)
    on_time = scaled_change(view, model, HUB_TORQUE, wave)
    late = scaled_change(view, late_sensors(model, 0.02), HUB_TORQUE, wave)
    moved = scaled_change(view, model, HUB_TORQUE, np.interp(view.time - 0.02, view.time, wave))
    assert np.abs(late - on_time).max() > 0.05
    np.testing.assert_allclose(late, moved, atol=0.01)
