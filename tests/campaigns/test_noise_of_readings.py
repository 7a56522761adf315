"""Noise that is read from a recording itself: that of the channel, not of its converter's luck."""

import numpy as np
import pytest

from twin.campaigns import readings
from twin.campaigns.readings import estimate_noise, quantisation_step

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
