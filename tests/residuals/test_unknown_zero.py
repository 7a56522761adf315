"""The zero of a sensor that nobody knows, estimated from what a model leaves of its readings."""

import numpy as np
import pytest

from twin.residuals.residual import without_zero

RNG = np.random.default_rng(5)
NOISE = RNG.normal(size=400)
EVERYWHERE = np.ones(400, dtype=bool)
ZERO = 3.0


def zero_of(off, known=EVERYWHERE):
    return float((off - without_zero(off, known))[0])


def test_it_is_found_behind_noise_and_an_excited_stretch():
    ringing = 20 * np.sin(np.arange(400)) * (np.arange(400) < 60)
    assert zero_of(ZERO + NOISE + ringing) == pytest.approx(ZERO, abs=0.15)


def test_it_changes_evenly_with_the_motion_of_the_link():
    """Fits of a first state need derivatives: here of a link that rings more, in steps of a noise level."""
    ringing = np.sin(0.05 * np.arange(400))
    found = np.array([zero_of(ZERO + NOISE + a * ringing) for a in np.linspace(0, 8, 9)])
    assert np.abs(np.diff(found, 2)).max() < 0.03


def test_what_is_missing_tells_nothing():
    known = EVERYWHERE & (np.arange(400) % 7 > 0)
    assert zero_of(np.where(known, ZERO + NOISE, 1e3), known) == pytest.approx(ZERO, abs=0.15)
    assert zero_of(NOISE, ~EVERYWHERE) == 0
