"""The low-pass of the hub's motion: wide for a good sensor, narrow where its noise may hide that the hub sticks."""

import numpy as np
import pytest

from twin.mechanics import chain
from twin.recording import Recording
from twin.residuals.filters import BAND, MOTION_BANDS
from twin.residuals.make_view import hub_signals
from twin.residuals.prepared import prepare
from twin.rigs import bossi2009
from twin.rigs.model import Model

PERIOD = 2e-3


def signals(noise, swing, kick=0.0, bands=MOTION_BANDS):
    """Of a hub that swings at 1.5 Hz by `swing` [rad], and at 15 Hz by `kick`; a sensor with this noise [rad]."""
    time = np.arange(0, 8, PERIOD)
    angle = swing * np.sin(3 * np.pi * time) + kick * np.sin(30 * np.pi * time)
    angle += noise * np.random.default_rng(3).standard_normal(len(time))
    recording = Recording("r", time, {"hub_angle": angle, "torque_command": np.zeros(len(time))})
    prepared, _ = prepare(recording, {"hub_angle": noise})
    rig = bossi2009.reconciled()
    return hub_signals(prepared, prepared.hub, Model(rig, {}, chain.fit_shape(rig, 6)), bands)


def values(found):
    """Independent values of the torque while the hub slides for certain, up to a constant factor."""
    return found.sliding.mean() * found.band


@pytest.mark.parametrize("noise", [1e-6, 1e-5])
def test_a_good_sensor_has_the_widest_band(noise):
    found = signals(noise, 0.4)
    assert found.band == MOTION_BANDS[0]
    assert found.sliding.mean() > 0.3


def test_a_rough_sensor_has_the_band_that_leaves_the_most_values_of_the_torque():
    found = signals(1e-3, 0.15, 0.02)
    assert BAND <= found.band < MOTION_BANDS[0]
    wide, *others = (b for b in MOTION_BANDS if b >= BAND)
    assert values(found) > values(signals(1e-3, 0.15, 0.02, (wide,)))
    assert values(found) == max(values(signals(1e-3, 0.15, 0.02, (b,))) for b in others)


def test_a_hub_that_hardly_moves_has_the_narrowest_band():
    assert signals(5e-3, 0.02).band == MOTION_BANDS[-1]
