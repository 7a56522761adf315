"""Simulation of some of the samples of a recording: the torque between two of them is averaged."""

import numpy as np
import pytest
from paths import ROOT

from twin.campaigns.campaign import read_campaign
from twin.estimation.calibrate import noise_levels
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.rigs import preset
from twin.rigs.model import FINE_STEP, Model, with_fine_chain
from twin.rigs.simulate import simulate

TIME = 1e-3 * np.arange(4001)
SENSORS = {
    "hub_angle": Sensor("hub_angle"),
    "tip_deflection": Sensor("tip_deflection"),
    "motor_torque": Sensor("motor_torque"),
    "torque_command": Sensor("torque_command"),
}
RESOLVED = {"hub_angle": 5e-4, "tip_deflection": 5e-4, "motor_torque": 1e-12}
"""What rough sensors resolve [rad], [m]; the torque is read at the samples."""


@pytest.fixture(scope="module", params=[0.0, 0.01], ids=["", "lag"])
def model(request):
    rig = preset("bossi2009").replace(hub_inertia=3e-3)
    lag = {"actuator-lag": {"time_constant": request.param}} if request.param else {}
    return Model(rig, SENSORS, chain.fit_shape(rig, 5), {"viscous-friction": {"viscous": 0.05}, **lag})


def recording(command):
    blank = {c: np.zeros_like(TIME) for c in RESOLVED}
    return Recording("a.csv", TIME, {"torque_command": command, **blank})


def commands():
    steps = 0.3 * np.sign(np.sin(2 * np.pi * 0.7 * TIME + 0.3))
    ripple = np.random.default_rng(1).choice([-0.05, 0.05], len(TIME))
    return {"steps": steps, "ripple": steps + ripple}


@pytest.mark.parametrize("kind", ["steps", "ripple"])
@pytest.mark.parametrize("stride", [2, 4])
def test_every_so_many_samples_are_those_of_all(model, kind, stride):
    measured = recording(commands()[kind])
    whole, some = simulate(model, measured, Start()), simulate(model, measured, Start(), stride=stride)
    np.testing.assert_array_equal(some.time, TIME[::stride])
    np.testing.assert_array_equal(some["torque_command"], measured["torque_command"][::stride])
    for channel, size in RESOLVED.items():
        np.testing.assert_allclose(some[channel], whole[channel][::stride], atol=size, err_msg=channel)


@pytest.mark.parametrize("file", ["torque-sweep.csv", "bang-bang-60.csv", "random-steps.csv"])
def test_the_fine_step_moves_no_channel_by_a_tenth_of_its_noise(file):
    """Over whole recordings in which the hub sticks and slides again and again."""
    campaign = read_campaign(ROOT / "twin" / "data" / "demo-rig")
    noise = noise_levels(campaign)
    recording = next(r for r in campaign.fit if r.name == file)
    start = Start(hub_angle=float(recording["hub_angle"][0]))
    model = with_fine_chain(Model(campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, 5)))
    coarse, fine = (simulate(m, recording, start) for m in (model, model.replace(step=FINE_STEP / 4)))
    for channel in ("hub_angle", "strain_base", "strain_mid"):
        moved = np.sqrt(np.mean((coarse[channel] - fine[channel]) ** 2))
        assert 0 < moved < 0.1 * noise[channel]
