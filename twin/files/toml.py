"""TOML files that the user names."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any

from twin.errors import InputError, shown
from twin.files.text import check_lines, read_text

_LARGEST = 10_000_000  # bytes; a campaign of thousands of recordings has less than one million
_LONGEST_LINE = 10_000  # characters; the parser's time for a key of many parts grows with its square
_DEEPEST = 32  # tables and lists in one another; the formats need 4


def read_toml(path: Path, what: str, name: str | None = None) -> dict[str, Any]:
    """Returns the content of a TOML file, in which all numbers are, or fit into, floats.

    Args:
      path: the file.
      what: what it should contain, for the message.
      name: name of the file in messages; None for that of the path.

    Raises:
      InputError: the file does not exist, cannot be read, or is not TOML in UTF-8.
    """
    name = path.name if name is None else name
    text = read_text(path, name, _LARGEST, f"{what} as a TOML file")
    check_lines(text, name, _LONGEST_LINE)
    try:
        content = tomllib.loads(text, parse_float=_float)
    except RecursionError:
        raise InputError(f"{name} {_too_deep(what)}") from None
    except ValueError as error:
        raise InputError(f"{name}{_syntax(str(error))}; expected {what} as TOML") from None
    _check_values(content, name, what)
    return content


def _too_deep(what: str) -> str:
    return f"has tables or lists nested more than {_DEEPEST} deep; expected {what} as TOML"


def _float(text: str) -> float:
    """Returns a TOML float; raises ValueError where it is a number beyond the largest."""
    value = float(text)
    if math.isinf(value) and "inf" not in text:
        raise ValueError(f"{shown(text)} is beyond the largest number, 1.8e308")
    return value


def _syntax(message: str) -> str:
    """Returns an error message of the parser with the place in front."""
    place = re.search(r" \(at (?:line (\d+), column (\d+)|end of document)\)$", message)
    if place is None:
        # Python's own limit, with advice on how to lift it.
        digits = re.match(r"Exceeds the limit \((\d+) digits\) for integer", message)
        return f": a whole number has more than {digits[1]} digits" if digits else f": {message}"
    line = f", line {place[1]}, column {place[2]}" if place[1] else ", at its end"
    return f"{line}: {message[: place.start()]}"


def _check_values(content: dict[str, Any], name: str, what: str) -> None:
    """Raises InputError where tables and lists are nested too deep, or a whole number is beyond a float."""
    pending: list[tuple[tuple[str, ...], Any]] = [((), content)]
    while pending:
        keys, value = pending.pop()
        if len(keys) > _DEEPEST:
            raise InputError(f"{name} {_too_deep(what)}")
        if isinstance(value, dict):
            pending.extend(((*keys, key), entry) for key, entry in value.items())
        elif isinstance(value, list):
            pending.extend(((*keys, str(k)), entry) for k, entry in enumerate(value, start=1))
        elif isinstance(value, int) and not _fits_float(value):
            field = ".".join(map(shown, keys))
            raise InputError(f"{name}: {field} is beyond the largest number, 1.8e308; expected a smaller one")


def _fits_float(value: int) -> bool:
    try:
        float(value)
    except OverflowError:
        return False
    return True
