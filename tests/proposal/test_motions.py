"""Which motions recordings hold: steps excite bending, slow sines do not; rests and decays are seen."""

from dataclasses import replace

import numpy as np
import pytest
from paths import ROOT

from twin.campaigns.campaign import read_campaign
from twin.proposal import gate, motions
from twin.recording import Recording, Sensor

TIME = 0.002 * np.arange(2000)
STEPS = 0.05 * np.sign(np.sin(2 * np.pi * TIME))
SINE = 0.05 * np.sin(np.pi * TIME)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))
TURNS = np.maximum(TIME - 1.0, 0.0) ** 2
"""Hub angle [rad] that rests for a second, then turns."""


@pytest.fixture(scope="module")
def demo():
    return read_campaign(ROOT / "twin" / "data" / "demo-rig")


@pytest.fixture
def campaign(demo):
    """Returns a function that makes a campaign of one recording."""

    def make(command=SINE, angle=TURNS, **changes):
        recording = Recording(
            "a.csv", TIME, {"torque_command": command, "hub_angle": angle + NOISE}, **changes
        )
        sensors = {"hub_angle": Sensor("hub_angle", noise=1e-4)}
        return replace(demo, fit=(recording,), sensors=sensors, _held_out=())

    return make


def test_a_fast_part_is_a_step_and_no_slow_sine(campaign):
    assert motions.fast_parts(campaign(STEPS)) == ["a.csv"]
    assert motions.fast_parts(campaign(SINE)) == []
    assert motions.fast_parts(campaign(0 * SINE)) == []


def test_a_decay_is_a_release_or_a_held_command_after_a_change(campaign):
    assert motions.decays(campaign(SINE)) == []
    assert motions.decays(campaign(np.where(TIME < 1, STEPS, 0.0))) == ["a.csv"]
    assert motions.decays(campaign(0 * SINE)) == []
    assert motions.decays(campaign(0 * SINE, clamped=True, initial_tip_deflection=0.02)) == ["a.csv"]


def test_a_rest_is_one_before_or_after_motion(campaign):
    assert motions.rests(campaign(angle=TURNS)) == ["a.csv"]
    assert motions.rests(campaign(angle=TIME**2 + TIME)) == []
    assert motions.rests(campaign(angle=0 * TIME)) == []


def test_directions_are_those_of_the_hub(campaign):
    assert motions.directions(campaign(angle=TURNS)) == {1}
    assert motions.directions(campaign(angle=np.sin(TIME))) == {1, -1}


def test_the_share_at_the_limit_is_counted(campaign, demo):
    limit = demo.rig["torque_limit"]
    assert motions.at_the_limit(campaign(np.where(TIME < 1, limit, 0.0))) == {"a.csv": pytest.approx(0.25)}
    assert motions.at_the_limit(campaign(0.5 * limit + 0 * TIME)) == {}


def test_what_no_recording_holds_is_named(campaign):
    found = {f.what: f for f in gate.look(campaign(SINE, TIME**2 + TIME))}
    for what in ("fast part", "decay", "rest of the hub", "directions"):
        assert not found[what].ok
        assert not found[what].fails
    assert found["saturation"].ok
