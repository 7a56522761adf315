"""Gaps of a recording: what the hub did in them is unknown, and so is what it did to the link."""

import pickle

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


def commanded(missing, step_at=1.0):
    whole = recording((5.0, 6.0))
    torque = np.where(whole.time < step_at, 0.1, -0.1)
    kept = (whole.time < missing[0]) | (whole.time > missing[1])
    return whole.replace(channels={"torque_command": torque}, sampled=True).part(kept)


def test_commands_that_are_listed_where_they_change_are_held():
    listed = commanded((0.99, 1.06)).replace(sampled=False)
    assert listed.commands[0] is listed.commanded_at
    assert listed.with_steps_before_gaps() is None
    assert not pickle.loads(pickle.dumps(listed)).sampled
    assert pickle.loads(pickle.dumps(commanded((0.99, 1.06)))).sampled


def test_a_command_is_held_where_no_rows_are_missing():
    whole = commanded((5.0, 6.0))
    assert whole.commands[0] is whole.commanded_at
    assert whole.with_steps_before_gaps() is None
    # One row that is lost: its command is held, as a card holds it that skips a tick.
    assert len(commanded((0.999, 1.001)).commands[0]) == len(whole) - 1


def test_commands_of_missing_rows_deliver_the_mean_impulse_of_a_step_anywhere_between():
    gap = (0.99, 1.06)
    lost = commanded(gap)
    held, torque = lost.commands
    assert np.all(np.diff(held) > 0)
    assert np.abs(np.diff(torque)).max() < 0.2 / 30
    begin, end = lost.time[lost.time < 1.0][-1], lost.time[lost.time > 1.0][0]
    impulses = []
    for step_at in np.arange(begin, end, PERIOD) + PERIOD:
        whole = commanded((5.0, 6.0), step_at)
        impulses.append(float(np.diff(whole.time, append=4.0) @ whole["torque_command"]))
    delivered = float(np.diff(held, append=4.0) @ torque)
    assert delivered == pytest.approx(np.mean(impulses), abs=0.2 * PERIOD)
    assert np.ptp(impulses) > 10 * 0.2 * PERIOD


def test_a_step_may_come_at_the_beginning_of_a_gap():
    lost = commanded((0.99, 1.06))
    sooner = lost.with_steps_before_gaps()
    begin = lost.time[lost.time < 1.0][-1]
    first = sooner.commanded_at[sooner["torque_command"] < 0][0]
    assert first == pytest.approx(begin + PERIOD)
    assert (np.diff(sooner.commanded_at) > 0).all()


def test_the_drive_of_a_model_takes_the_commands_of_missing_rows():
    lost = commanded((0.99, 1.06))
    drive = Model(RIG, {}, chain.fit_shape(RIG, 6)).drive(lost)
    assert abs(float(drive.at(np.array([1.026]))[0])) < 0.01
    assert drive.at(lost.time) == pytest.approx(lost["torque_command"])


@pytest.mark.parametrize("deviation", [0.0, -0.04, 0.03])
def test_what_a_kick_in_a_gap_does_to_the_link_counts_for_nothing(deviation):
    model, time = Model(RIG, {}, chain.fit_shape(RIG, 6)), np.arange(0, 4, PERIOD)
    moving = np.ones(len(time))
    modes = ringing.ringing_modes(model, time, moving, 0.0, 25.0, [(1.0, 10.0)])
    rings = ringing.from_columns(np.hstack([m.pull * m.coordinate(time) for m in modes]) / 1e-3)
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
    rings = ringing.from_columns(100 * noise._unseen(known))
    bump = 10 * np.exp(-(((time - 0.96) / 0.02) ** 2))
    assert np.std(rings.whitened(bump)) < 0.1 * np.std(bump)
    assert noise._unseen(np.ones(len(time), dtype=bool)).shape == (len(time), 0)
