"""Derivatives of the residuals by a wave, of which spectra are made, beside small differences of the equations."""

import numpy as np
import pytest
from rig_campaigns import planned

from twin.diagnosis import spectrum
from twin.diagnosis.rays import with_effect
from twin.diagnosis.spectrum import Peak
from twin.effects import REGISTRY
from twin.estimation.calibrate import calibrate
from twin.estimation.residual_pool import ResidualPool


@pytest.fixture(scope="module")
def ringing(rig_campaign):
    """A calibrated rig on a slew and behind a pull, whose link rings for seconds."""
    runs = planned(4152, "bang-bang", "free-vibration")
    with ResidualPool(1) as pool:
        start = calibrate(rig_campaign({}, 4152, experiments=[runs[-1], runs[0]]).read(), pool)
        assert any(
            r.directions.shape[1] > 0 for view in start.bench.data.views for r in view.ringing.values()
        )
        yield start


# With the amplitude of the wave: small, and yet far above rounding.
LIKE_THE_EQUATIONS = {
    "cogging": (5.0, 1e-3, 0.99),
    "position-dependent-friction": (5.0, 1e-3, 0.95),
    "periodic-disturbance": (9.0, 1e-3, 0.99),
    "torsional-mode": (20.0, 1e-3, 0.95),
    "hub-sensor-nonlinearity": (5.0, 1e-4, 0.8),
}


@pytest.mark.parametrize("name", LIKE_THE_EQUATIONS)
def test_a_wave_changes_the_residuals_as_its_slopes_say(ringing, name):
    order, size, alike = LIKE_THE_EQUATIONS[name]
    effect, kind = REGISTRY[name], REGISTRY[name].wave.acts
    slopes = spectrum.wave_slopes(ringing.bench, ringing.base, effect, Peak(order, (), 0.0, acts=kind))
    # Friction cannot fall below its level: sine and cosine come with a constant, the third coefficient.
    coefficients = size * np.eye(slopes.shape[1])[0] + (size * np.eye(3)[2] if kind == "friction" else 0.0)
    values = effect.wave_parameters(order, tuple(coefficients))
    assert _similarity(ringing, name, values, slopes @ coefficients) > alike


def test_a_shaken_base_bends_a_link_that_is_bent_already(ringing):
    slopes = spectrum.wave_slopes(
        ringing.bench, ringing.base, REGISTRY["periodic-disturbance"], Peak(9.0, (), 0.0, acts="shake")
    )
    for k, direction in ((0, 0.0), (2, np.pi / 2)):
        values = {"frequency": 9.0, "amplitude": 0.02, "phase": 0.0, "base": 1.0, "direction": direction}
        assert _similarity(ringing, "periodic-disturbance", values, 0.02 * slopes[:, k]) > 0.7


def _similarity(start, name, values, predicted):
    """One less the share of the change of the residual by an effect that a prediction of it leaves, its sign kept."""
    model = with_effect(start.base.model, name, values)
    [residual] = start.bench.residuals([(model, start.base.starts, None)])
    change = residual - start.base.residual
    return 1 - np.linalg.norm(change - predicted) / np.linalg.norm(change)
