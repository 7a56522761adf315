"""Noise that is read from a recording itself: that of the channel, not of its converter's luck."""

import numpy as np
import pytest

from twin.campaigns import readings
from twin.campaigns.readings import estimate_noise, quantisation_step, without_outliers
from twin.recording import Recording

TIME = np.arange(0.0, 11.0, 2e-3)
NOISE = 9e-4


def swing(step, noise=NOISE, rate=4.0):
    """A hub that swings fast, rests in between, and is read by a converter of this step [rad]."""
    angle = 0.8 * np.sin(rate * TIME) * (np.sin(0.8 * TIME) > 0)
    read = angle + noise * np.random.default_rng(0).standard_normal(len(TIME))
    return step * np.rint(read / step)


@pytest.mark.parametrize("step", [1e-5, 3e-4, 8.5e-4, 1.5e-3])
def test_it_is_that_of_the_sensor_whatever_the_step_of_its_converter(step):
    true = np.hypot(NOISE, step / np.sqrt(12))
    assert estimate_noise(swing(step)) == pytest.approx(true, rel=0.06)


@pytest.mark.parametrize("samples", [20, 50, 200])
def test_the_length_of_a_stretch_does_not_matter(monkeypatch, samples):
    monkeypatch.setattr(readings, "_STRETCH", samples)
    assert estimate_noise(swing(3e-4)) == pytest.approx(NOISE, rel=0.06)


def test_a_coarse_converter_has_the_noise_of_its_step():
    assert estimate_noise(swing(0.02, noise=1e-6)) >= 0.999 * 0.02 / np.sqrt(12)


def test_a_fast_signal_that_skips_levels_has_the_step_of_its_converter():
    skipped = 2e-3 * np.rint(np.repeat([0.0, 0.4, -0.3, 0.9, 0.102, 0.104], 200) / 2e-3)
    assert quantisation_step(skipped) == pytest.approx(2e-3)


def test_a_few_outliers_and_jumps_are_no_noise():
    values = swing(1e-4)
    values[::500] += 0.5
    assert estimate_noise(values) == pytest.approx(NOISE, rel=0.06)


def moving_with_gaps():
    """A hub that swings by 1 rad at 0.5 Hz with 7 Hz upon it, sampled at 500 Hz; rows are missing, and readings."""
    time = 0.002 * np.arange(3000)
    kept = np.ones(len(time), dtype=bool)
    for begin in (300, 900, 1700, 2300):
        kept[begin : begin + 40] = False
    time = time[kept]
    angle = np.sin(np.pi * time) + 0.03 * np.sin(14 * np.pi * time)
    angle += 3e-4 * np.random.default_rng(0).standard_normal(len(time))
    angle[500:510] = np.nan
    return time, angle


def outliers_of(time, angle):
    found, notes = without_outliers(Recording("a", time, {"hub_angle": angle}), {"hub_angle": 3e-4})
    return np.flatnonzero(np.isnan(found["hub_angle"]) & np.isfinite(angle)).tolist(), notes


def test_readings_beside_missing_ones_are_no_outliers():
    assert outliers_of(*moving_with_gaps()) == ([], [])


@pytest.mark.parametrize("places", [(299,), (300,), (510,), (1000,), (1000, 1001), (800, 801, 1200)])
def test_lone_readings_are_outliers_beside_gaps_too(places):
    time, angle = moving_with_gaps()
    angle[list(places)] += 0.02 * (-1.0) ** np.arange(len(places))
    found, notes = outliers_of(time, angle)
    assert found == list(places)
    assert notes == [f"a: {len(places)} outlier{'s' if len(places) > 1 else ''} in hub_angle left out"]


def test_of_two_readings_behind_a_gap_both_may_be_the_outlier():
    time, angle = moving_with_gaps()
    angle[511] += 0.02
    assert outliers_of(time, angle)[0] == [510, 511]


def test_a_signal_that_moves_fast_has_no_outliers():
    time = 0.002 * np.arange(1000)
    kicked = 0.1 * np.exp(-np.maximum(time - 1, 0) / 0.004) * np.sin(2 * np.pi * 90 * (time - 1)) * (time > 1)
    assert outliers_of(time, kicked)[0] == []
