"""Where names, units and numbers stand in a text table: preamble, header, separator, row of units, decimal sign."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.errors import LARGEST, InputError, shown

_COMMENTS = ("#", "%")  # begin a line of the preamble
MOST_COLUMNS = 10_000
"""Columns of a file at most: a card has some hundreds of channels."""
_BLANKS = " "
# Words by which a row of units is known: each recording has a time, each static test a length or a load.
_UNIT_WORDS = (
    "s",
    "sec",
    "ms",
    "us",
    "µs",
    "min",
    "h",
    "m",
    "mm",
    "N",
    "kg",
    "g",
    "V",
    "mV",
    "A",
    "mA",
    "rad",
    "deg",
)
_IN_BRACKETS = re.compile(r"\[.*\]|\(.*\)")


@dataclass(frozen=True)
class Layout:
    """Parts of a text table.

    Attributes:
      separator: "," ";" tab, or a blank for any number of blanks and tabs.
      header: names of the columns.
      head: index of the header's line.
      body: index of the first line that may hold numbers.
      units: column -> unit as the row below the header gives it; empty where there is none.
    """

    separator: str
    header: tuple[str, ...]
    head: int
    body: int
    units: Mapping[str, str] = field(default_factory=dict)

    def cells(self, line: str, where: str) -> list[str]:
        """Returns the fields of a line; raises InputError where it has none."""
        return _split(line, self.separator, where)


def find_layout(lines: list[str], name: str) -> Layout:
    """Returns the layout of a text table.

    Args:
      lines: the text.
      name: name of the file in messages.

    Raises:
      InputError: it has no valid header.
    """
    head = _after_preamble(lines)
    line, body = lines[head] if head < len(lines) else "", head + 1
    if not line.strip():
        number = min(head, len(lines) - 1) + 1
        raise InputError(
            f"{name}, line {number} is empty; expected a header line with the names of the columns"
        )
    separator = _separator(line, _next(lines, body))
    header = _names(line, separator, f"{name}, line {head + 1}")
    if all(is_number(cell.replace(",", ".")) for cell in header):
        above = _commented_header(lines[:head], separator, len(header))
        if above is None:
            raise InputError(
                f"{name}, line {head + 1} is '{shown(line)}'; expected a header line with the names of the columns"
            )
        head, header, body = head - 1, above, head
    _check_names(header, f"{name}, line {head + 1}")
    units = _units(_next(lines, body), separator, header)
    after = next((i + 1 for i in range(body, len(lines)) if lines[i].strip()), body) if units else body
    return Layout(separator, header, head, after, units)


def _after_preamble(lines: list[str]) -> int:
    """Index of the first line that is no comment; empty lines below a comment belong to the preamble."""
    head = 0
    while head < len(lines) and (
        lines[head].lstrip().startswith(_COMMENTS) or (head and not lines[head].strip())
    ):
        head += 1
    return head


def _next(lines: list[str], start: int) -> str:
    return next((line for line in lines[start:] if line.strip()), "")


def _separator(header: str, row: str) -> str:
    """The separator of a header and of the row below it; blanks only where both have as many words."""
    count = {sign: header.count(sign) for sign in (",", ";", "\t")}
    most = max(count, key=lambda sign: count[sign])
    if count[most]:
        return most
    words = _words(header)
    return _BLANKS if 1 < len(words) == len(row.split()) else ","


def _words(line: str) -> list[str]:
    """Words between blanks, each with the unit in brackets behind it."""
    return re.findall(r"\S+(?: (?:\[[^\]]*\]|\([^)]*\)))?", line)


def _split(line: str, separator: str, where: str) -> list[str]:
    if separator == _BLANKS:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator))
    except csv.Error as error:
        raise InputError(f"{where}: {error}; expected numbers between separators") from None


def _names(line: str, separator: str, where: str) -> tuple[str, ...]:
    cells = _words(line) if separator == _BLANKS else _split(line, separator, where)
    return tuple(cell.strip() for cell in cells)


def _commented_header(preamble: list[str], separator: str, width: int) -> tuple[str, ...] | None:
    """The names in the comment directly above the numbers; None where it has not as many."""
    if not preamble or not preamble[-1].strip():
        return None
    line = preamble[-1].strip().lstrip("".join(_COMMENTS)).strip()
    # numpy.savetxt and others separate the names by commas, whatever separates the numbers.
    for sign in (separator, ",", ";", "\t", _BLANKS):
        names = _names(line, sign, "")
        if len(names) == width and not all(is_number(cell) for cell in names):
            return names
    return None


def _check_names(header: tuple[str, ...], where: str) -> None:
    if len(header) > MOST_COLUMNS:
        raise InputError(f"{where} has {len(header)} columns; expected at most {MOST_COLUMNS}")
    twice = [column for column, count in Counter(header).items() if column and count > 1]
    if twice:
        raise InputError(f"{where}: column '{shown(twice[0])}' occurs twice; expected each name once")


def _units(line: str, separator: str, header: tuple[str, ...]) -> dict[str, str]:
    """Units by column in a row below the header; empty where the row holds something else."""
    try:
        cells = [cell.strip() for cell in _split(line, separator, "")]
    except InputError:
        return {}
    words = [cell for cell in cells if cell]
    if len(cells) != len(header) or not any(_is_unit(cell) for cell in words):
        return {}
    if any(is_number(cell.replace(",", ".")) or cell.lower() == "nan" for cell in words):
        return {}
    units = {name: unbracketed(cell) for name, cell in zip(header, cells, strict=True)}
    return {name: unit for name, unit in units.items() if unit}


def _is_unit(cell: str) -> bool:
    return cell in _UNIT_WORDS or bool(_IN_BRACKETS.fullmatch(cell))


def unbracketed(text: str) -> str:
    """Returns a unit without the brackets around it."""
    return text[1:-1].strip() if _IN_BRACKETS.fullmatch(text) else text


def is_number(cell: str) -> bool:
    """Whether a field is a number of acceptable size."""
    try:
        return abs(float(cell)) <= LARGEST and "_" not in cell
    except ValueError:
        return False
