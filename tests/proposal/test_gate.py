"""What is said of data before a fit: nothing stands against good ones, and each defect is named."""

import numpy as np
import pytest
from campaign_folder import CHANNELS, FIT, GAUGE, HUB, motion, toml_text, write
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
        "hub_angle: 0.00011 in the readings, 0.01 declared (SI)"
    )


def test_slow_samples_are_named(tmp_path):
    hub = {name: lines for name, lines in CHANNELS.items() if name != "strain_base"}
    stiff = toml_text(hub, rig=f'rig = "my-rig"\n\n[parameters]\n{PARAMETERS_STIFF}')
    assert "samples per period of the first mode at least" in warned(write(tmp_path, stiff))["rate"]


PARAMETERS_STIFF = "length = 0.4\nlinear_density = 0.1\nbending_stiffness = 25\nhub_inertia = 0.02"


def test_what_a_campaign_lacks_is_told_at_once(twin, tmp_path):
    gauge = GAUGE.replace("position = 0.02\n", "")
    channels = CHANNELS | {"strain_base": gauge, "hub_angle": 'unit = "V"'}
    code, _, error = twin("data", write(tmp_path, toml_text(channels, rig='rig = "my-rig"')))
    assert code == 2
    assert "missing: bending_stiffness, linear_density, length, hub_inertia" in error
    assert "channels.hub_angle.gain is missing" in error
    assert "channels.strain_base.position is missing" in error
