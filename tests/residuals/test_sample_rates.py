"""Noise of recordings at other rates than that of the grid: what is predicted of it, beside what passes the filters."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from twin.recording import Recording
from twin.residuals import noise, resample
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, STRIDE, low_passed, smooth_spline

SPAN, SIGMA = 40.0, 0.3  # s, noise of a reading
GRID_TIME = np.arange(0.0, SPAN - 1.0, GRID)
PERIODS = [1e-4, 5e-4, 1e-3, 1.5e-3, 2e-3, 4e-3, 1e-2]


def _noisy(period, channel):
    time = np.arange(0.0, SPAN, period)
    drawn = np.random.default_rng(3).normal(0.0, SIGMA, len(time))
    return Recording("a.csv", time, {channel: drawn})


def _inside(values):
    return values[200:-200]


@pytest.mark.parametrize("period", PERIODS)
def test_noise_behind_the_low_pass_is_that_of_the_readings(period):
    for channel in ("strain_base", "motor_torque"):
        recording = _noisy(period, channel)
        prepared = SimpleNamespace(recording=recording, noise={channel: SIGMA}, channels=(channel,))
        predicted = noise.sensor_noise(prepared, {})[channel]
        found = np.std(_inside(low_passed(resample.resample_channel(recording, channel, GRID_TIME)[0], GRID)))
        # The band of the filter is 0.9 of its cut-off; linear interpolation of slow readings takes a third at most.
        least = 0.6 if channel == "motor_torque" and period > 5e-3 else 0.85
        assert least * predicted < found < 1.08 * predicted


@pytest.mark.parametrize("period", PERIODS)
def test_noise_of_the_hub_is_simulated_as_it_is_read(period):
    recording = _noisy(period, "hub_angle")
    read = low_passed(resample.resample_channel(recording, "hub_angle", GRID_TIME)[0], GRID, 45.0)
    still = np.zeros(len(GRID_TIME))
    signals = noise.Signals(
        GRID_TIME, still, still, still, still, still > 0, {}, {}, (), 45.0, {}, still == 0
    )
    prepared = SimpleNamespace(recording=recording, noise={"hub_angle": SIGMA})
    drawn = noise._with_hub_noise(signals, prepared, np.random.default_rng(5), np.ones(len(GRID_TIME)))
    found = np.std(_inside(smooth_spline(GRID_TIME, read)(GRID_TIME, 2)))
    assert np.std(_inside(drawn.acceleration)) == pytest.approx(found, rel=0.12)


def test_a_dense_signal_keeps_its_shape():
    time = np.arange(0.0, 4.0, 2e-4)
    recording = Recording("a.csv", time, {"strain_base": np.sin(2 * np.pi * 25.0 * time)})
    grid = np.arange(0.1, 3.9, GRID)
    found, _ = resample.resample_channel(recording, "strain_base", grid)
    np.testing.assert_allclose(found, np.sin(2 * np.pi * 25.0 * grid), atol=1e-4)


def test_slow_readings_count_once():
    data = SimpleNamespace(prepared=[SimpleNamespace(recording=_noisy(p, "hub_angle")) for p in (0.002, 0.1)])
    fast, slow = (DrivenData._independent(data, i) / (STRIDE * GRID) for i in (0, 1))
    assert (fast, slow) == pytest.approx((50.0, 10.0))
