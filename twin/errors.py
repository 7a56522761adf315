"""Errors in the user's input, reported with a message instead of a traceback."""

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Bad input: the message names the file and line or field, the value found, and what was expected.

    The command line prints the message and returns 2.
    """


def nearest(word: str, known: Iterable[str]) -> str:
    """Returns "; did you mean 'x'?" for the known word most similar to `word`, or "" if none is similar."""
    match = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{match[0]}'?" if match else ""
