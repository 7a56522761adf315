"""What is sound in a recording: stretches between gaps and jumps of the hub angle."""

import numpy as np
import pytest

from twin.campaigns.readings import longest_valid_stretch
from twin.campaigns.rests import classify_hub_motion
from twin.mechanics.planar import STUCK
from twin.recording import Recording

TIME = np.arange(0.0, 4.0, 1e-3)
NOISE, STRONGEST = 3e-4, 500.0


def recording(angle, **channels):
    return Recording("run", TIME, {"torque_command": np.zeros(len(TIME)), "hub_angle": angle, **channels})


def swing():
    return 0.8 * np.sin(3 * TIME)


def test_a_sound_recording_is_kept_whole():
    whole = recording(swing())
    assert longest_valid_stretch(whole, NOISE, STRONGEST) == (whole, None)


def test_the_longest_stretch_is_kept_without_the_readings_beside_the_gap():
    angle = swing()
    angle[(TIME > 1.0) & (TIME < 1.2)] = np.nan
    at = np.searchsorted(TIME, 1.2)
    angle[at : at + 5] += 0.07  # the wiper is not yet on its track
    angle[at + 18 : at + 24] = np.nan
    cut, note = longest_valid_stretch(recording(angle, strain_base=TIME.copy()), NOISE, STRONGEST)
    assert cut.time[0] == pytest.approx(1.224, abs=1e-3)
    assert np.isfinite(cut["hub_angle"]).all()
    assert cut.time[-1] == TIME[-1]
    assert cut.start == "unknown"
    np.testing.assert_array_equal(cut["strain_base"], cut.time)
    np.testing.assert_allclose(cut["hub_angle"], 0.8 * np.sin(3 * cut.time), atol=1e-12)
    assert "used from 1.2" in note


def test_a_turn_lost_in_unwrapping_ends_a_stretch():
    angle = swing()
    angle[3000:] += 2 * np.pi
    cut, _ = longest_valid_stretch(recording(angle), NOISE, STRONGEST)
    assert cut.start == "rest"
    assert cut.time[0] == 0.0
    assert cut.time[-1] == pytest.approx(2.98, abs=2e-3)


def test_a_clamped_hub_has_nothing_to_follow():
    held = recording(swing()).replace(clamped=True)
    assert longest_valid_stretch(held, NOISE, STRONGEST) == (held, None)


@pytest.mark.parametrize("count", [3, 8, 20])
def test_a_recording_shorter_than_a_rest_tells_what_it_can(count):
    angle = 0.1 + 1e-4 * np.random.default_rng(1).normal(size=count)
    short = Recording("", 0.002 * np.arange(count), {"hub_angle": angle})
    seen = classify_hub_motion(short, 1e-4)
    assert seen.observed.shape == (count,)
    assert not np.isin(seen.observed, [1, -1]).any()


def test_a_part_whose_clock_hung_is_classified():
    time = np.r_[0.002 * np.arange(100), 0.2 + 1e-12 * np.arange(1, 200), 0.202 + 0.002 * np.arange(50)]
    part = Recording("a.csv", time, {"hub_angle": 0.1 * time})
    assert len(classify_hub_motion(part, 1e-4).observed) == len(time)


def test_a_hub_that_a_link_rocks_on_a_flank_does_not_rest():
    noise = NOISE * np.random.default_rng(2).normal(size=len(TIME))
    still = classify_hub_motion(recording(0.1 + noise), NOISE)
    assert (still.observed == STUCK).mean() > 0.9
    # In 0.08 s it moves by less than the noise.
    rocked = classify_hub_motion(recording(0.1 + noise + 2 * NOISE * np.sin(2 * np.pi * 0.3 * TIME)), NOISE)
    assert (rocked.observed == STUCK).mean() < 0.1


def test_a_hub_rests_though_neighbouring_samples_have_the_same_noise():
    noise = np.repeat(np.random.default_rng(3).normal(size=len(TIME) // 5), 5)
    seen = classify_hub_motion(recording(0.1 + NOISE * noise), NOISE)
    assert (seen.observed == STUCK).mean() > 0.5
