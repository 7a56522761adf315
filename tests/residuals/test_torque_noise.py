"""Noise of the torque balance: what noise of the hub angle makes of a link that rings for a third of a second."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from twin.mechanics import chain
from twin.recording import Recording
from twin.residuals import noise
from twin.residuals.filters import GRID, STRIDE
from twin.residuals.make_view import make_view
from twin.residuals.prepared import prepare
from twin.residuals.ringing import MIN_DECAY_TIME
from twin.rigs import bossi2009
from twin.rigs.model import Model

PERIOD, SIGMA = 2e-3, 3e-4  # s; rad, noise of the hub angle
RIG = bossi2009.reconciled()
MODEL = Model(RIG, {}, chain.fit_shape(RIG, 6))


@pytest.fixture(scope="module")
def turning():
    """A view of a hub that turns and never rests, and the recording."""
    time = np.arange(0, 12, PERIOD)
    angle = 3.0 * time + 0.2 * np.sin(2 * np.pi * time)
    angle += SIGMA * np.random.default_rng(7).standard_normal(len(time))
    recording = Recording("r", time, {"hub_angle": angle, "torque_command": np.full(len(time), 0.01)})
    prepared, _ = prepare(recording, {"hub_angle": SIGMA})
    return make_view(prepared, MODEL), prepared


def _peak(view, prepared):
    """Power of the noise of the torque within 1 Hz of the second clamped mode, over that within 5 Hz."""
    drawn, generator = [], np.random.default_rng(11)
    plain, _ = noise._simulated(view, view, prepared, MODEL)
    for _ in range(6):
        noisy, _ = noise._simulated(
            noise._with_hub_noise(view, prepared, generator, np.ones(len(view.time))), view, prepared, MODEL
        )
        drawn.append(noisy["hub_torque"] - plain["hub_torque"])
    f, power = welch(np.array(drawn), 1 / (STRIDE * GRID), nperseg=250)
    second = MODEL.chain.modes("clamped")[0][1] / (2 * np.pi)
    mean = power.mean(axis=0)
    return float(mean[np.abs(f - second) < 1].mean() / mean[np.abs(f - second) < 5].mean())


def test_a_mode_that_rings_too_shortly_for_the_strains_is_whitened_in_the_torque(turning):
    view, prepared = turning
    assert view.sliding.mean() > 0.9
    rate = MODEL.chain.damping_ratios("clamped")[1] * MODEL.chain.modes("clamped")[0][1]
    assert rate * MIN_DECAY_TIME > 1
    coloured = replace(view, ringing={c: r for c, r in view.ringing.items() if c != "hub_torque"})
    assert _peak(coloured, prepared) > 1.2
    assert _peak(view, prepared) < 0.8
