"""Sensors that count the wrong way round are refused; no physics is taken for one."""

import numpy as np
import pytest

from twin.campaigns import check_channels
from twin.campaigns.campaign import read_campaign
from twin.errors import InputError
from twin.recording import Recording, Sensor
from twin.rigs import preset
from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.experiments import bang_bang, torque_sweep

HARD = {
    "cable-torsion": {"stiffness": 0.012, "rest_angle": 0.15},
    "gravity-tilt": {"tilt": 0.05, "direction": 0.4},
    "actuator-delay": {"delay": 0.004},
}


@pytest.fixture(scope="module")
def folder(rig_campaign):
    draw = np.random.default_rng(1)
    plan = [bang_bang(Rig(), Sensors(), draw, 90.0), torque_sweep(Rig(), Sensors(), draw)]
    return rig_campaign(HARD, 3, experiments=[*plan, bang_bang(Rig(), Sensors(), draw, 60.0)]).folder


def scaled(folder, channel, gain, tmp_path):
    """The campaign with one channel said to have another gain."""
    for file in folder.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    toml = tmp_path / "campaign.toml"
    head = f"[channels.{channel}]\n"
    assert head in toml.read_text()
    toml.write_text(toml.read_text().replace(head, f"{head}gain = {gain}\n"))
    return tmp_path


def test_right_ones_pass(folder):
    assert len(read_campaign(folder).fit) > 1


CHANNELS = ["torque_command", "motor_torque", "hub_angle", "strain_base", "strain_mid"]


@pytest.mark.parametrize("channel", CHANNELS)
def test_it_is_told_which_one_is_turned(folder, channel, tmp_path):
    with pytest.raises(
        InputError, match=rf"channels\.{channel}: .* wrong way round in \S+\.csv.*sign of its gain"
    ):
        read_campaign(scaled(folder, channel, -1.0, tmp_path))


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize(("gain", "size"), [(57.3, "large"), (1e6, "large"), (1e-3, "small")])
def test_it_is_told_which_one_has_another_unit(folder, channel, gain, size, tmp_path):
    with pytest.raises(
        InputError, match=rf"channels\.{channel}: it is some [0-9]+ times too {size} in \S+\.csv"
    ):
        read_campaign(scaled(folder, channel, gain, tmp_path))


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("gain", [0.1, 10.0])
def test_a_wrong_gain_is_for_the_diagnosis(folder, channel, gain, tmp_path):
    assert read_campaign(scaled(folder, channel, gain, tmp_path)).name


def driven_against_a_spring(*frequencies):
    """A rigid arm on a spring, driven below its resonance: it speeds up against the torque, as it should."""
    time, inertia, stiffness = np.arange(0, 20, 0.002), 0.01, 0.2
    waves = [0.2 * np.sin(2 * np.pi * f * time) for f in frequencies]
    speeding = sum(-((2 * np.pi * f) ** 2) * wave for f, wave in zip(frequencies, waves, strict=True))
    angle = sum(waves) + 1e-4 * np.random.default_rng(0).standard_normal(len(time))
    torque = inertia * speeding + stiffness * sum(waves)
    assert np.corrcoef(torque, speeding)[0, 1] < -0.5
    return Recording(
        "slow", time, {"torque_command": torque, "hub_angle": angle, "strain_base": -1e-5 * speeding}
    )


@pytest.mark.parametrize("frequencies", [(0.3,), (0.2, 0.5)])
def test_a_spring_is_no_turned_sensor(frequencies):
    slow, gauge = driven_against_a_spring(*frequencies), Sensor("strain_base", 1e-6, 0.02, 0.001)
    check_channels.check_signs_and_units([slow], {"strain_base": gauge}, preset("bossi2009"))


def test_a_torque_that_the_hub_does_not_follow_is_refused_no_more_often_than_by_chance():
    """On a hub that sticks nearly always, friction holds the torque, and what moves has nothing to do with it."""
    draw, time, refused = np.random.default_rng(4), np.arange(0, 5, 0.01), 0
    for _ in range(200):
        torque, speeding = np.repeat(0.1 * draw.standard_normal((2, 50)), 10, axis=1)
        angle = np.cumsum(np.cumsum(speeding)) * 0.01**2
        try:
            recording = Recording("stairs", time, {"torque_command": torque, "hub_angle": angle})
            check_channels.check_signs_and_units([recording], {}, preset("bossi2009"))
        except InputError:
            refused += 1
    assert refused <= 1  # by a correlation of 0.6 alone, whatever the number of samples, it were 4 to 10
