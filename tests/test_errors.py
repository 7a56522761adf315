"""Messages may quote a file: what it holds neither commands the terminal nor hides what was expected."""

import pickle

import pytest

from twin.errors import InputError, exact, listed, nearest, shown


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
