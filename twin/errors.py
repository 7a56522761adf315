"""Errors in the user's input, reported with a message instead of a traceback."""

import difflib
from collections.abc import Collection, Iterable

_LONGEST_MESSAGE = 4000  # characters: some fifty lines of a terminal
_LONGEST_QUOTE = 60  # characters of a text from a file
_LONGEST_LIST = 24  # names
_LONGEST_WORD = 100  # characters of words that are compared, in a time that grows with their square


class InputError(ValueError):
    """Bad input: the message names the file and line or field, the value found, and what was expected.

    The command line prints the message and returns 2. As it may quote a file, control characters in it are escaped,
    those that reverse the direction of writing included, and its length is bounded.
    """

    def __init__(self, message: str) -> None:
        whole = _escaped(message[: _LONGEST_MESSAGE + 1])
        super().__init__(whole if len(whole) <= _LONGEST_MESSAGE else f"{whole[:_LONGEST_MESSAGE]} ...")


def nearest(word: str, known: Iterable[str]) -> str:
    """Returns "; did you mean 'x'?" for the known word most similar to `word`, or "" if none is similar."""
    words = [other for other in known if len(other) <= _LONGEST_WORD]
    match = difflib.get_close_matches(word[:_LONGEST_WORD], words, n=1, cutoff=0.6)
    return f"; did you mean '{match[0]}'?" if match else ""


def shown(text: str) -> str:
    """Returns a text from a file as a message shows it: on one line, its control characters escaped, cut if long."""
    cut = text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE]}..."
    return _escaped(cut).replace("\n", "\\n")


def listed(names: Collection[str]) -> str:
    """Returns names from a file as a message shows them: the first ones, and how many more there are."""
    first = [shown(name) for name, _ in zip(names, range(_LONGEST_LIST), strict=False)]
    more = len(names) - len(first)
    return ", ".join(first) + (f" and {more} more" if more else "")


def exact(value: float) -> str:
    """Returns a number with as many digits as tell it from every other one."""
    return repr(float(value)).removesuffix(".0")


def _escaped(text: str) -> str:
    """Returns a text with what cannot be printed, but newlines, as Python's escape sequences."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)
