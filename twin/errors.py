"""Errors in the user's input, reported with a message instead of a traceback."""

import difflib
import math
from collections.abc import Collection, Iterable
from numbers import Integral, Real
from typing import Any

LARGEST = 1e100
"""Magnitude of the largest accepted number: squares of larger ones overflow."""
_DIGITS = 1e15  # whole numbers beyond this are shown by their size
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
    match = difflib.get_close_matches(str(word)[:_LONGEST_WORD], words, n=1, cutoff=0.6)
    return f"; did you mean '{match[0]}'?" if match else ""


def quoted(value: Any) -> str:
    """Returns a wrong value as a message shows it: as in TOML, of bounded length, without control characters."""
    if value is None:
        return "missing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and abs(value) > _DIGITS:
        return f"a whole number of {round(value.bit_length() * math.log10(2)) + 1} digits"
    return f"'{shown(value)}'" if isinstance(value, str) else shown(str(value))


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


def checked_number(
    field: str, value: Any, low: float = -LARGEST, high: float = LARGEST, unit: str = ""
) -> float:
    """Returns a number as it came from a file or a caller.

    Args:
      field: what it is, for the message.
      value: the number; not a bool, not NaN.
      low, high: smallest and largest possible value.
      unit: of all three, for the message.

    Raises:
      InputError: it is no number from `low` to `high`.
    """
    if not _is_a(Real, value) or value != value:
        raise InputError(f"{field} is {quoted(value)}; expected a number")
    if not isinstance(value, Integral):
        value = float(value)
    if low <= value <= high and (abs(value) <= LARGEST or isinstance(value, float)):
        return float(value)
    whole = isinstance(value, int)
    found, infinite = (quoted(value), False) if whole else (f"{value:g}", math.isinf(value))
    of = "" if unit in ("", "1") or infinite else f" {unit}"
    raise InputError(f"{field} is {found}{of}; expected {_range(low, high, infinite)}{of}")


def _is_a(kind: type, value: Any) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


def _range(low: float, high: float, infinite: bool) -> str:
    """The numbers from `low` to `high` in words."""
    kind = "a finite number" if infinite else "a number"
    if low <= -LARGEST or high >= LARGEST:
        least = "" if low <= -LARGEST else f" >= {low:g}"
        most = "" if high >= LARGEST else f" <= {high:g}"
        return kind + (least or most or ("" if infinite else f" up to {LARGEST:g}"))
    return f"{kind}, {low:g} to {high:g}" if infinite else f"{low:g} to {high:g}"


def checked_count(field: str, value: Any, low: int, high: int) -> int:
    """Returns a whole number from `low` to `high`; raises InputError where `value` is none."""
    if not _is_a(Integral, value):
        raise InputError(f"{field} is {quoted(value)}; expected a whole number from {low} to {high}")
    if not low <= value <= high:
        raise InputError(f"{field} is {quoted(int(value))}; expected {low} to {high}")
    return int(value)
