"""Messages quote files and callers: neither commands the terminal nor hides what was expected."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin.errors import (
    LARGEST,
    InputError,
    checked_count,
    checked_number,
    exact,
    listed,
    nearest,
    quoted,
    shown,
)

ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(),
    st.binary(),
    st.complex_numbers(),
    st.lists(st.integers()),
    st.dictionaries(st.text(), st.integers()),
    st.integers(min_value=10**300, max_value=10**6000),
)


LIMITS = [(-LARGEST, LARGEST), (0.0, 10.0), (1e-9, math.inf), (-math.inf, math.inf)]


def said(check, *arguments):
    """What a check says of a value that it refuses; its number where it accepts it."""
    try:
        return check(*arguments)
    except InputError as error:
        return str(error)


@given(ANYTHING, st.sampled_from(LIMITS))
def test_a_number_is_in_its_range_or_refused_in_a_line(value, limits):
    found = said(checked_number, "gap", value, *limits, "rad")
    if isinstance(found, float):
        assert limits[0] <= found <= limits[1]
    else:
        assert found.startswith("gap is ")
        assert "; expected " in found
        assert len(found) < 200
        assert found.isprintable()


@given(ANYTHING)
def test_a_count_is_in_its_range_or_refused_in_a_line(value):
    found = said(checked_count, "rigs", value, 1, 100)
    if isinstance(found, int):
        assert 1 <= found <= 100
    else:
        assert len(found) < 200
        assert found.isprintable()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (-5, "gap is -5 rad; expected 0 to 6 rad"),
        (np.float64(7.5), "gap is 7.5 rad; expected 0 to 6 rad"),
        (math.inf, "gap is inf; expected a finite number, 0 to 6"),
        (math.nan, "gap is nan; expected a number"),
        (True, "gap is true; expected a number"),
        ("0.1", "gap is '0.1'; expected a number"),
        (None, "gap is missing; expected a number"),
        (10**400, "gap is a whole number of 401 digits rad; expected 0 to 6"),
    ],
)
def test_messages(value, message):
    with pytest.raises(InputError) as raised:
        checked_number("gap", value, 0.0, 6.0, "rad")
    assert str(raised.value).startswith(message)


def test_a_long_text_is_cut_and_cleaned():
    assert quoted("\x1b[31m" + 100 * "x") == f"'\\x1b[31m{'x' * 55}...'"


def test_what_is_no_word_has_no_nearest_one():
    assert nearest(5, ["chain"]) == ""  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("raw", "safe"),
    [
        ("\x1b]0;title\x07\x1b[2J", "\\x1b]0;title\\x07\\x1b[2J"),
        ("\u202eb\u2066a\ufeff", "\\u202eb\\u2066a\\ufeff"),
        ("a\rb\tc\x7f\x9b", "a\\rb\\tc\\x7f\\x9b"),
        ("\udcff", "\\udcff"),
        ("Gelenk ü 角 é²", "Gelenk ü 角 é²"),
        ("two\nlines", "two\nlines"),
    ],
)
def test_control_characters_of_a_message_are_escaped(raw, safe):
    assert str(InputError(raw)) == safe
    assert shown(raw) == safe.replace("\n", "\\n")


def test_a_message_is_bounded_and_survives_another_process():
    error = InputError("\x1b" + "x" * 10_000)
    assert len(str(error)) < 4010
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_long_texts_and_many_names_are_cut():
    assert shown("x" * 100) == "x" * 60 + "..."
    assert listed(["a", "b\x1b"]) == "a, b\\x1b"
    assert listed([f"c{k}" for k in range(100)]).endswith("c23 and 76 more")


def test_similar_words_of_any_length():
    assert nearest("tiem", ["time", "x" * 1_000_000]) == "; did you mean 'time'?"
    assert nearest("y" * 1_000_000, ["x" * 1_000_000]) == ""


def test_numbers_show_what_tells_them_apart():
    assert exact(1.7312e9) == "1731200000"
    assert exact(1731200000.002) == "1731200000.002"
    assert exact(0.1 + 0.2) != exact(0.3)
