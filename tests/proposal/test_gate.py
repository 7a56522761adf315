"""What is said of data before a fit: nothing stands against good ones, and each defect is named."""

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, HELD_OUT, HUB, INERTIA, RIG, motion, toml_text, write
from paths import ROOT

from twin.campaigns.campaign import read_campaign
from twin.proposal import gate

DEMO = ROOT / "twin" / "data" / "demo-rig"


def warned(folder) -> dict[str, str]:
    return {f.what: f.text for f in gate.look(read_campaign(folder)) if not f.ok}


def test_nothing_stands_against_the_bundled_campaign():
    assert warned(DEMO) == {}


def test_what_is_missing_is_named(tmp_path):
    found = [
        f.text for f in gate.look(read_campaign(write(tmp_path, toml_text(recordings=(FIT,))))) if not f.ok
    ]
    assert "no recording is held out, so that no prediction can be tested" in found
    assert "no recording has a locked hub, which shows the link alone" in found
    assert any(text.startswith("[uncertainty] of ") and "bending_stiffness" in text for text in found)


def moving():
    columns = motion()
    return {**columns, "hub_angle": columns["hub_angle"] + 0.5 * columns["time"]}


def jittering():
    columns = motion()
    jitter = 2e-5 * np.random.default_rng(0).standard_normal(500)
    return {**columns, "time": columns["time"] + jitter}


@pytest.mark.parametrize(
    ("make", "what", "text"),
    [
        (moving, "rest", 'something moves at the first sample of push.csv; is start = "unknown"?'),
        (jittering, "clock", "time stamps scatter about a uniform clock in push.csv"),
    ],
)
def test_defects_of_a_recording_are_named(tmp_path, make, what, text):
    campaign = read_campaign(write(tmp_path, push=make()))
    [found] = [f for f in gate.look(campaign) if f.what == what]
    assert (found.ok, found.text, found.fails) == (False, text, what == "rest")


def test_a_wrong_noise_is_named(tmp_path):
    channels = CHANNELS | {"hub_angle": HUB.replace("1e-4", "1e-2")}
    assert warned(write(tmp_path, toml_text(channels)))["noise"] == (
        "hub_angle: 0.0001 rad in the readings, 0.01 rad declared"
    )


def test_slow_samples_are_named(tmp_path):
    hub = {name: lines for name, lines in CHANNELS.items() if name != "strain_base"}
    stiff = toml_text(hub, rig=f'rig = "my-rig"\n\n[parameters]\n{PARAMETERS_STIFF}')
    assert "samples per period of the first mode at least" in warned(write(tmp_path, stiff))["rate"]


PARAMETERS_STIFF = "length = 0.4\nlinear_density = 0.1\nbending_stiffness = 25\nhub_inertia = 0.02"


def test_units_that_are_missing_are_told_with_all_else_that_is(twin, tmp_path):
    gauge = "noise = 1e-6"
    channels = {"torque_command": "", "hub_angle": 'unit = "V"', "strain_base": gauge}
    code, _, error = twin("data", write(tmp_path, toml_text(channels, rig='rig = "my-rig"')))
    assert code == 2
    for text in (
        "channels.torque_command.unit is missing",
        "channels.strain_base.unit is missing",
        "missing: bending_stiffness, linear_density, length, hub_inertia",
        "channels.hub_angle.gain is missing",
        "channels.strain_base.position is missing",
        "channels.strain_base.half_thickness is missing",
    ):
        assert text in error


def test_what_a_campaign_lacks_is_told_at_once(twin, tmp_path):
    gauge = GAUGE.replace("position = 0.02\n", "")
    channels = CHANNELS | {"strain_base": gauge, "hub_angle": 'unit = "V"'}
    code, _, error = twin("data", write(tmp_path, toml_text(channels, rig='rig = "my-rig"')))
    assert code == 2
    assert "missing: bending_stiffness, linear_density, length, hub_inertia" in error
    assert "channels.hub_angle.gain is missing" in error
    assert "channels.strain_base.position is missing" in error


# Signs and sizes that no slow part of a recording shows


def driven_fast(sign: float = 1.0):
    """A command that turns a hub at a rate, as a voltage does, and a link that rings at 5.8 Hz and turns it."""
    rng = np.random.default_rng(2)
    time, ringing = 0.002 * np.arange(4000), 2 * np.pi * 5.8
    command = sign * np.where(time % (2 / 3) < 1 / 3, 1.0, -1.0)
    turn = 0.002 * np.cumsum(command)
    strain = 2e-4 * np.sin(ringing * time)
    bending_torque = 0.25 * strain / 0.001
    noise = rng.standard_normal((2, len(time)))
    return {
        "time": time,
        "torque_command": 0.1 * command,
        "hub_angle": turn - bending_torque / 0.02 / ringing**2 + 1e-4 * noise[0],
        "strain_base": strain + 1e-6 * noise[1],
    }


def fast_campaign(folder, rig: str = "", loop: str = "open", **lines: str):
    """The campaign with lines added to its channels."""
    channels = {name: f"{text}\n{lines.get(name, '')}" for name, text in CHANNELS.items()}
    more = f'\nstart = "unknown"\nloop = "{loop}"'
    toml = toml_text(channels, (FIT + more, HELD_OUT + more), RIG + rig)
    return read_campaign(write(folder, toml, push=driven_fast(), pull=driven_fast(-1.0)))


def test_right_signs_are_seen(tmp_path):
    found = {f.what: f for f in gate.look(fast_campaign(tmp_path, "\nstatic_friction = 0.05"))}
    assert not any(f.fails for f in found.values())
    assert found["hub, command"].text.startswith("the sign of the command is right, as it drives the hub")
    assert found["hub, link"].text == "strain_base: its sign is right in 2 of 2 recordings that show it"


@pytest.mark.parametrize(
    ("channel", "what"),
    [("torque_command", "hub, command"), ("hub_angle", "hub, command"), ("strain_base", "hub, link")],
)
def test_a_turned_channel_fails(tmp_path, channel, what):
    campaign = fast_campaign(tmp_path, **{channel: "gain = -1"})
    [found] = [f for f in gate.look(campaign) if f.fails]
    assert found.what == what
    assert found.text.startswith(f"{channel} counts the wrong way round")


def test_bending_says_nothing_of_a_sign_under_a_controller(tmp_path):
    campaign = fast_campaign(tmp_path, loop="closed", strain_base="gain = -1")
    assert "hub, link" not in {f.what for f in gate.look(campaign)}


@pytest.mark.parametrize(("gain", "fails"), [(0.3, False), (0.001, True)])
def test_a_command_that_friction_would_hold_is_named(tmp_path, gain, fails):
    campaign = fast_campaign(tmp_path, "\nstatic_friction = 0.05", torque_command=f"gain = {gain}")
    [found] = [f for f in gate.look(campaign) if f.what == "friction"]
    assert (found.ok, found.fails) == (False, fails)
    assert found.text.startswith(
        f"the largest command is {0.1 * gain:.2g} N·m, less than the declared static_friction"
    )
    assert "of 0.05 N·m, and yet the hub travels 0.34 rad" in found.text


def test_a_hub_that_gives_its_energy_to_the_drive_passes(tmp_path):
    columns = motion()
    time = columns["time"]
    columns["torque_command"] = np.full(len(time), -0.02)
    columns["hub_angle"] = 3 * time - 0.5 * 0.02 / INERTIA * time**2
    assert 0.02 / INERTIA * time[-1] < 3  # it turns to the end
    toml = toml_text(recordings=(f'{FIT}\nstart = "unknown"',))
    assert not any(f.fails for f in gate.look(read_campaign(write(tmp_path, toml, push=columns))))
