"""Gaps of a recording: what the hub did in them is unknown, and so is what it did to the link."""

import numpy as np
import pytest

from twin.mechanics import chain
from twin.recording import Recording
from twin.residuals import noise, resample, ringing
from twin.rigs import bossi2009
from twin.rigs.model import Model

PERIOD = 2e-3
RIG = bossi2009.reconciled()


def recording(missing):
    time = np.arange(0, 4, PERIOD)
    kept = (time < missing[0]) | (time > missing[1])
    return Recording("r", time[kept], {"hub_angle": np.sin(time[kept])}, False)


def test_a_gap_has_its_first_and_last_reading():
    [(begin, end)] = resample.gaps_of(recording((1.0, 1.05)), "hub_angle")
    assert begin == pytest.approx(1.0, abs=1.5 * PERIOD)
    assert end == pytest.approx(1.05, abs=1.5 * PERIOD)
    assert resample.gaps_of(recording((5.0, 6.0)), "hub_angle") == []


def test_rows_are_missing_only_where_nothing_was_recorded():
    whole = recording((5.0, 6.0))
    angle = np.where((whole.time > 1.0) & (whole.time < 1.05), np.nan, whole["hub_angle"])
    lost = whole.replace(channels={"hub_angle": angle})
    assert len(resample.gaps_of(lost, "hub_angle")) == 1
    assert resample.missing_rows(lost) == []
    assert len(resample.missing_rows(recording((1.0, 1.05)))) == 1


@pytest.mark.parametrize("deviation", [0.0, -0.04, 0.03])
def test_what_a_kick_in_a_gap_does_to_the_link_counts_for_nothing(deviation):
    model, time = Model(RIG, {}, chain.fit_shape(RIG, 6)), np.arange(0, 4, PERIOD)
    moving = np.ones(len(time))
    modes = ringing.ringing_modes(model, time, moving, 0.0, 25.0, [(1.0, 10.0)])
    rings = ringing.from_columns(np.hstack([m.pull * m.coordinate for m in modes]) / 1e-3)
    frequencies, _ = model.chain.modes("clamped")
    w, z = frequencies[1] * (1 + deviation), model.chain.damping_ratios("clamped")[1]
    later = np.maximum(time - 1.0, 0.0)
    residual = np.where(time > 1.0, 50 * np.exp(-z * w * later) * np.sin(w * later + 0.7), 0.0)
    assert np.std(rings.whitened(residual)) < 0.02 * np.std(residual)
    # An oscillation that no kick in the gap makes stays.
    other = np.sin(2 * np.pi * 8 * time)
    assert np.std(rings.whitened(other)) > 0.95 * np.std(other)


def test_any_course_within_a_gap_counts_for_nothing():
    time = np.arange(0, 2, PERIOD)
    known = (time < 0.9) | (time > 1.0)
    rings = ringing.from_columns(100 * noise._unseen(time, known))
    bump = 10 * np.exp(-(((time - 0.96) / 0.02) ** 2))
    assert np.std(rings.whitened(bump)) < 0.1 * np.std(bump)
    assert noise._unseen(time, np.ones(len(time), dtype=bool)).shape == (len(time), 0)
