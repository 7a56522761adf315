"""Stamps of date and time as ISO 8601 writes them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from datetime import datetime

from twin.errors import InputError, shown

_STAMP = re.compile(
    r"(?P<minute>\d{4}-\d\d-\d\d[T ]\d\d:\d\d)(?P<second>:\d\d)?(?P<fraction>[.,]\d+)? ?(?P<zone>Z|[+-]\d\d(:?\d\d)?)?"
)


def is_stamp(cell: str) -> bool:
    """Whether a field is a date and a time of day, as `2024-03-01T12:00:00.000` or `2024-03-01 12:00:00,000+01:00`."""
    return _STAMP.fullmatch(cell.strip()) is not None


def seconds(cells: Sequence[str], missing: Sequence[str], column: str, places: Sequence[str]) -> list[float]:
    """Returns the instants of a column of stamps [s] from its first one; NaN where a field is missing.

    Args:
      cells: the fields.
      missing: what stands in a field that is missing, lower case.
      column: name of the column.
      places: file and line of each field, for messages.

    Raises:
      InputError: a field is no stamp, or one has a time zone and another one has none.
    """
    return list(_seconds(cells, missing, column, places))


def _seconds(
    cells: Sequence[str], missing: Sequence[str], column: str, places: Sequence[str]
) -> Iterator[float]:
    first: tuple[datetime, float] | None = None
    for cell, place in zip(cells, places, strict=True):
        if cell.strip().lower() in missing:
            yield math.nan
            continue
        found = _parsed(cell, first)
        if found is None:
            example = "2024-03-01T12:00:00.000" + ("" if first is None or first[0].tzinfo is None else "Z")
            actual = f"{shown(column)} is '{shown(cell)}'"
            raise InputError(f"{place}: {actual}; expected a date and time like {example}, as above it")
        first = first or found
        # The fractions are subtracted apart: a double holds seconds since 1970 to 0.2 µs only.
        yield (found[0] - first[0]).total_seconds() + (found[1] - first[1])


def _parsed(cell: str, first: tuple[datetime, float] | None) -> tuple[datetime, float] | None:
    """The second of a stamp and its fraction [s]; None where it is none, or cannot be compared with the first."""
    match = _STAMP.fullmatch(cell.strip())
    if match is None:
        return None
    try:
        whole = datetime.fromisoformat(match["minute"] + (match["second"] or "") + (match["zone"] or ""))
    except ValueError:
        return None
    if first is not None and (whole.tzinfo is None) != (first[0].tzinfo is None):
        return None
    return whole, float("0." + match["fraction"][1:]) if match["fraction"] else 0.0
