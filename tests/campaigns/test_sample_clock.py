"""The uniform clock about which time stamps jitter: found where there is one, and not where stamps are rounded."""

import numpy as np
import pytest

from twin.campaigns.readings import sample_clock


@pytest.mark.parametrize(("rate", "span"), [(1e3, 20.0), (2e3, 20.0), (1e4, 20.0), (500.0, 60.0)])
def test_stamps_of_an_epoch_are_a_clean_clock(rate, span):
    assert sample_clock(1709290800.123 + np.arange(round(rate * span)) / rate) is None


@pytest.mark.parametrize("begin", [0.0, 3.3, 1709290800.123])
@pytest.mark.parametrize(("rate", "jitter"), [(300.0, 0.0), (500.0, 0.12), (500.0, 0.02), (50.0, 0.1)])
def test_the_clock_behind_jitter_and_rounding(rate, jitter, begin):
    draw = np.random.default_rng(8)
    true = np.arange(3000) / rate
    kept = np.sort(draw.permutation(len(true))[:-40])  # rows that are missing
    stamps = true + draw.normal(0.0, jitter, len(true)) / rate if jitter else np.round(true, 3)
    found = sample_clock(begin + stamps[kept])
    off = found - begin - true[kept]
    assert np.ptp(off) < 0.05 / rate
    assert abs(off.mean()) < 0.05 / rate


def test_stamps_without_a_clock_have_none():
    draw = np.random.default_rng(9)
    assert sample_clock(np.cumsum(draw.uniform(0.5, 1.5, 3000)) * 2e-3) is None
