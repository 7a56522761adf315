"""Ringing of the link under noise of the hub, weighed against the noise of the sensors."""

import numpy as np
import pytest

from twin.residuals import ringing
from twin.residuals.filters import GRID, INDEPENDENT, STRIDE, low_passed


def test_a_direction_in_which_the_link_rings_counts_as_much_as_any_other_within_the_band():
    time = GRID * np.arange(2000)
    generator, kicks = np.random.default_rng(0), np.arange(0.2, 3.6, 0.2)
    later = time[:, None] - kicks
    columns = 2 * np.exp(-0.5 * np.maximum(later, 0)) * np.where(later > 0, np.sin(40 * later), 0)
    rings = ringing.from_columns(np.sqrt(INDEPENDENT) * columns[::STRIDE])
    noise = low_passed(generator.normal(size=(400, len(time))), GRID)
    drawn = (noise / np.std(noise) + generator.normal(size=(400, len(kicks))) @ columns.T)[:, ::STRIDE]
    assert np.std(drawn) > 1.5
    left = rings.whitened(drawn)
    other = np.sin(2 * np.pi * 17 * time[::STRIDE])
    sizes = [np.mean((left @ d) ** 2) for d in (*rings.directions.T, other / np.linalg.norm(other))]
    assert sizes == pytest.approx([1 / INDEPENDENT] * len(sizes), rel=0.35)
