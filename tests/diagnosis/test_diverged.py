"""Driven data under a fit to output errors under which the link of one recording diverges."""

from dataclasses import replace

import numpy as np
import pytest
from rig_campaigns import planned
from threadpoolctl import threadpool_limits

from twin.diagnosis import dependence, link_functions, spectrum
from twin.effects import REGISTRY
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool
from twin.mechanics import planar

RATE = 0.01


@pytest.fixture(scope="module")
def start(rig_campaign):
    slews = planned(4152, "bang-bang-45", "random-steps")
    with threadpool_limits(1), ResidualPool(1) as pool:
        yield calibrate(rig_campaign({}, 4152, experiments=slews).read(), pool)


@pytest.fixture
def fit(start, monkeypatch):
    """The link of the first recording diverges."""
    lengths = [len(view.time) for view in start.data.views]
    assert lengths.count(lengths[0]) == 1
    simulated = planar.simulate_prescribed_hub

    def lost(plant, time, hub, *args):
        angles, rates, required = simulated(plant, time, hub, *args)
        if len(time) == lengths[0]:
            angles[1:, 1:], rates[1:, 1:], required[1:] = np.nan, np.nan, np.nan
        return angles, rates, required

    monkeypatch.setattr(planar, "simulate_prescribed_hub", lost)
    declared = start.base.model.declared  # another stiffness, so that no motion is known
    softer = declared.replace(bending_stiffness=0.99 * declared["bending_stiffness"])
    return replace(start.base, model=start.base.model.replace(declared=softer))


@pytest.mark.parametrize("name", [name for name, effect in REGISTRY.items() if effect.wave is not None])
def test_spectra_are_of_the_others(start, fit, name):
    peaks = spectrum.spectral_peaks(start.bench, fit, REGISTRY[name])
    assert all(np.isfinite([peak.gain, *peak.coefficients]).all() for peak in peaks)
    slopes = spectrum.wave_slopes(start.bench, fit, REGISTRY[name], peaks[0])
    assert np.isfinite(slopes).all()
    lost = [g.rows for g in start.data.groups if g.recording == 0]
    assert all((slopes[rows] == 0).all() for rows in lost)


def test_residuals_are_of_the_others(start, fit):
    for channel, left in dependence.unexplained_residuals(start.bench, fit).items():
        assert np.isfinite(left.values).all(), channel
        assert all(np.isfinite(values).all() for values in left.variables.values()), channel


def test_functions_on_the_link_are_of_the_others(start, fit):
    functions = link_functions.functions_of(start.bench, fit, RATE)
    assert functions
    assert all(np.isfinite(f.evidence) for f in functions)
