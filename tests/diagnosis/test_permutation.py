"""The permutation test: tail of its distribution, bound of the posterior probability, probabilities of candidates."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.diagnosis import permutation, rules


def candidate(name, score):
    return SimpleNamespace(name=name, score=score)


@pytest.mark.parametrize("scale", [3.0, 8.0])
def test_tail_beyond_the_draws_falls_as_they_do(scale):
    # Quantiles of an exponential distribution stand for draws of it.
    draws = -scale * np.log(1 - (np.arange(400) + 0.5) / 400)
    for score in (0.5 * scale, 3 * scale, 12 * scale):
        assert np.log(permutation.p_value(draws, score)) == pytest.approx(-score / scale, rel=0.05)


def test_draws_that_hardly_differ_do_not_make_a_little_more_impossible():
    assert permutation.p_value(np.full(400, 20.0), 22.0) == pytest.approx(0.1 * np.exp(-2))


def test_what_chance_gives_once_in_a_hundred_is_not_sure():
    assert permutation.posterior_bound(0.01) == pytest.approx(0.889, abs=1e-3)
    assert permutation.posterior_bound(1e-9) > 0.9999
    assert permutation.posterior_bound(0.0) == 1.0
    assert permutation.posterior_bound(0.5) == permutation.posterior_bound(1 / np.e) == 0.5


def test_probabilities_leave_room_for_chance():
    draws = -7 * np.log(1 - (np.arange(400) + 0.5) / 400)
    ranked = [candidate("cogging", 33.0), candidate("cable-torsion", 33.0), candidate("torque-bias", 2.0)]
    found = rules.probabilities(ranked, draws)
    assert found["cogging"] == found["cable-torsion"]
    assert sum(found.values()) == pytest.approx(permutation.posterior_bound(permutation.p_value(draws, 33.0)))
    assert sum(found.values()) < 0.95
