"""What the user gave cannot be used."""

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Bad input: the message names the file and line or field, what was found, what would be right.

    The command line prints it and returns 2.
    """


def nearest(word: str, known: Iterable[str]) -> str:
    """Returns "; did you mean 'x'?" for the known word nearest to `word`, or "" if none is near."""
    match = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{match[0]}'?" if match else ""
