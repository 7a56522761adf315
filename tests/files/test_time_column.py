"""Time columns: what no recording has is refused, and its likely cause is named."""

import numpy as np
import pytest

from twin.errors import InputError
from twin.files.table import Table
from twin.files.time_column import checked_time

SECONDS = 0.002 * np.arange(500)


def table(time) -> Table:
    time = np.asarray(time, dtype=float)
    return Table("a.csv", ("time",), {"time": time}, np.arange(len(time)) + 2, "a.csv, line 1")


def refusal(time) -> str:
    with pytest.raises(InputError) as caught:
        checked_time(table(time), "time")
    return str(caught.value)


UNITS = {
    "milliseconds": SECONDS * 1e3,
    "microseconds": SECONDS * 1e6,
    "nanoseconds": SECONDS * 1e9,
    "milliseconds since 1970": 1.7e12 + SECONDS * 1e3,
    "microseconds since 1970": 1.7e15 + SECONDS * 1e6,
    "nanoseconds since 1970": 1.7e18 + SECONDS * 1e9,
    "minutes": SECONDS / 60,
    "hours": SECONDS / 3600,
    "days": SECONDS / 86400,
    "days, as MATLAB's datenum counts them": 739000.5 + SECONDS / 86400,
    "days, as spreadsheets count them": 45000.2 + SECONDS / 86400,
    "days, as Julian dates": 2460000.5 + SECONDS * 100 / 86400,
}


@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_of_a_time_that_is_not_in_seconds_is_guessed(unit):
    assert refusal(UNITS[unit]).endswith(f": is it in {unit}? Convert it to s")


@pytest.mark.parametrize("time", [SECONDS[:20], SECONDS * 1e-300, SECONDS * 1e90])
def test_no_unit_is_guessed_where_none_fits(time):
    assert refusal(time).endswith(" s: is it in s?")


@pytest.mark.parametrize("epoch", [0.0, -3.0, 1.7312e9, 3.8e9])
@pytest.mark.parametrize("period", [2e-5, 0.002, 0.1])
def test_seconds_are_accepted_from_any_epoch(epoch, period):
    time = epoch + period * np.arange(10_000)
    np.testing.assert_array_equal(checked_time(table(time), "time"), time)


def jumped(by: float, at: int = 400) -> np.ndarray:
    return SECONDS + np.where(np.arange(500) >= at, by, 0.0)


def test_a_clock_that_was_set_is_named_by_its_line():
    message = refusal(jumped(1.7e9))
    assert message.startswith("a.csv, line 402: time is 1700000000.8 after 0.798; expected one recording")


def test_a_long_recording_may_not_pause_for_a_day():
    hours = 0.1 * np.arange(200_000)
    paused = hours + np.where(hours > 100, 90_000.0, 0.0)
    assert "was a clock set" in refusal(paused)


def test_gaps_are_accepted_up_to_the_span_that_the_samples_could_fill():
    checked_time(table(jumped(70.0)), "time")
    assert "was a clock set" in refusal(jumped(100.0))
    bursts = (10.0 * np.arange(500)[:, None] + SECONDS[:50]).ravel()
    assert "was a clock set" in refusal(bursts)
    checked_time(table(np.unique(np.random.default_rng(0).choice(100_000, 10_000)) * 0.002), "time")


def test_stamps_with_too_few_digits_show_all_that_they_have():
    coarse = np.round(1.7312e9 + SECONDS)
    message = refusal(coarse)
    assert message == (
        "a.csv, line 3: time is 1731200000 after 1731200000; expected it to increase strictly; "
        "its numbers have too few digits"
    )


def test_a_step_back_shows_enough_digits():
    time = 1.7312e9 + SECONDS
    time[7] = time[5]
    assert "line 9: time is 1731200000.01 after 1731200000.012; expected" in refusal(time)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_instant_that_is_no_number(bad):
    assert refusal(np.r_[0.0, bad, 0.2]) == "a.csv, line 3: time is missing; expected a number"
