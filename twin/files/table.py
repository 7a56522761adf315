"""Text tables of numbers: a fast reader, and a slow one that reports errors with line and column."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from twin.errors import LARGEST, InputError, shown
from twin.files.layout import Layout, find_layout, is_number
from twin.files.stamps import is_stamp, seconds
from twin.files.text import check_lines, read_text

_MISSING = ("", "nan")  # fields of a missing sample, lower case
LARGEST_FILE = 1_000_000_000
"""Accepted size of a file of recorded numbers [bytes]: three hours at 1 kHz with ten columns of ten characters."""
_LOOKED_AT = 20  # rows by which a column of numbers is known
_LONGEST_LINE = 1_000_000  # characters


@dataclass(frozen=True)
class Table:
    """Columns of one file.

    Attributes:
      name: name of the file in messages.
      header: all columns of the file, in order, also those that were not read.
      columns: name -> (n) values; NaN where a sample is missing.
      lines: (n) number of each row: its line in the file, or that of the sample.
      top: name of the file and of the place in it where the names of the columns stand.
      rows: what `lines` counts.
      units: column -> unit, as far as the file says it.
      note: what else the file holds that could not be read, for a message that a column is missing; else "".
    """

    name: str
    header: tuple[str, ...]
    columns: Mapping[str, np.ndarray] = field(repr=False)
    lines: np.ndarray = field(repr=False)
    top: str
    rows: str = "line"
    units: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def place(self, row: int) -> str:
        """Returns the name of the file and the place of a row in it, counted from 0."""
        return f"{self.name}, {self.rows} {self.lines[row]}"


def read_table(
    path: Path, name: str, wanted: Collection[str] | None = None, numeric_only: bool = False
) -> Table:
    """Reads a text table: names of the columns in a header, separated by commas, semicolons, tabs or blanks.

    A preamble of comments and a row of units may stand above the numbers, and numbers have a decimal comma where commas
    do not separate them.

    Args:
      path: the file.
      name: name of the file in messages.
      wanted: columns to read, as far as the file has them; None for all. Other columns need not be numbers.
      numeric_only: leave out columns that begin with something else than numbers or instants.

    Raises:
      InputError: the file cannot be read as such a table.
    """
    try:
        return parse_table(_text(path, name), name, wanted, numeric_only)
    except MemoryError:
        raise InputError(f"{name} does not fit into the memory; expected a shorter file") from None


def _text(path: Path, name: str) -> str:
    text = read_text(path, name, LARGEST_FILE, "a CSV file", older_encodings=True)
    check_lines(text, name, _LONGEST_LINE)
    return text


def parse_table(text: str, name: str, wanted: Collection[str] | None, numeric_only: bool = False) -> Table:
    """Returns the table in a text; see `read_table`."""
    lines = text.split("\n")
    layout = find_layout(lines, name)
    used = [i for i, column in enumerate(layout.header) if wanted is None or column in wanted]
    rows = np.array([i + 1 for i in range(layout.body, len(lines)) if lines[i].strip()], dtype=int)
    body = [lines[i - 1] for i in rows]
    first = _first_cells(body, rows, layout, name)
    stamped = [i for i in used if first[i] and is_stamp(first[i][0])]
    numeric = [i for i in used if i not in stamped and not (numeric_only and not _are_numbers(first[i]))]
    values = _fast(body, layout, numeric)
    if values is None:
        values = np.array(list(_slow(body, rows, layout, numeric, name))).reshape(len(body), len(numeric))
    found = {i: values[:, j] for j, i in enumerate(numeric)}
    found |= {i: _instants(body, rows, layout, i, name) for i in stamped}
    columns = {layout.header[i]: found[i] for i in used if i in found}
    units = {**layout.units, **{layout.header[i]: "s" for i in stamped}}
    return Table(name, layout.header, columns, rows, f"{name}, line {layout.head + 1}", units=units)


def _first_cells(body: list[str], rows: np.ndarray, layout: Layout, name: str) -> list[list[str]]:
    """The fields of each column in the first rows, without those that are missing."""
    first: list[list[str]] = [[] for _ in layout.header]
    for line, row in zip(body[:_LOOKED_AT], rows, strict=False):
        cells = [cell.strip() for cell in layout.cells(line, f"{name}, line {row}")]
        for column, cell in zip(first, cells, strict=False):
            if cell.lower() not in _MISSING:
                column.append(cell)
    return first


def _are_numbers(cells: list[str]) -> bool:
    return all(is_number(cell.replace(",", ".")) for cell in cells)


def _instants(body: list[str], rows: np.ndarray, layout: Layout, column: int, name: str) -> np.ndarray:
    """The instants of a column of stamps (n) [s] from the first; raises InputError with line and column."""
    places = [f"{name}, line {row}" for row in rows]
    cells = [_cells(line, layout, place)[column] for line, place in zip(body, places, strict=True)]
    return np.array(seconds(cells, _MISSING, layout.header[column], places))


def _cells(line: str, layout: Layout, where: str) -> list[str]:
    """The fields of a line; raises InputError where it has more or fewer than the header."""
    cells = layout.cells(line, where)
    if len(cells) != len(layout.header):
        raise InputError(f"{where} has {_ragged(cells, len(layout.header))}")
    return cells


def _fast(body: list[str], layout: Layout, used: list[int]) -> np.ndarray | None:
    """Returns the used columns (n, k), or None where a line is irregular in any way."""
    separator, width = layout.separator, len(layout.header)
    if not body or not used or {_fields(line, separator) for line in body} != {width}:
        return None
    text = "\n".join(body)
    if separator != "," and "," in text:
        if "." in text:
            return None
        body, text = [line.replace(",", ".") for line in body], text.replace(",", ".")
    if separator != " " and (separator * 2 in f"{separator}{text}{separator}" or _open(text, separator)):
        body = [_fill(line, separator) for line in body]
    try:
        delimiter = None if separator == " " else separator
        values = np.loadtxt(body, delimiter=delimiter, comments=None, usecols=used, ndmin=2)
    except ValueError:
        return None
    return None if (np.abs(values) > LARGEST).any() else values


def _fields(line: str, separator: str) -> int:
    return len(line.split()) if separator == " " else line.count(separator) + 1


def _open(text: str, separator: str) -> bool:
    """Whether a line begins or ends with a separator."""
    return f"{separator}\n" in text or f"\n{separator}" in text


def _fill(line: str, separator: str) -> str:
    """Returns a line with "nan" in empty fields."""
    # The first replacement misses every second of several empty fields in a row.
    double, filled = separator * 2, f"{separator}nan{separator}"
    return f"{separator}{line}{separator}".replace(double, filled).replace(double, filled)[1:-1]


def _slow(
    body: list[str], rows: np.ndarray, layout: Layout, used: list[int], name: str
) -> Iterator[list[float]]:
    """Yields the used fields of each row; raises InputError with line and column."""
    split = [_cells(line, layout, f"{name}, line {row}") for line, row in zip(body, rows, strict=True)]
    decimal = _decimal(split, layout, used)
    for cells, row in zip(split, rows, strict=True):
        yield [_number(cells[i], decimal, layout.header[i], f"{name}, line {row}") for i in used]


def _decimal(split: list[list[str]], layout: Layout, used: list[int]) -> str:
    """The decimal sign: a comma where no comma separates, and a used field has one."""
    if layout.separator == ",":
        return "."
    return "," if any(i < len(cells) and "," in cells[i] for cells in split for i in used) else "."


def _ragged(cells: list[str], width: int) -> str:
    # Decimal commas, 1,5 for 1.5, double the number of fields that are no whole numbers.
    doubled = width < len(cells) <= 2 * width and all(is_number(cell) for cell in cells)
    hint = "; if the comma is the decimal sign, write a decimal point" if doubled else ""
    return f"{len(cells)} fields; expected {width}, as in the header{hint}"


def _number(cell: str, decimal: str, column: str, where: str) -> float:
    text = cell.strip()
    if text.lower() in _MISSING:
        return math.nan
    if decimal == "," and "." not in text:
        text = text.replace(",", ".")
    if is_number(text) and not (decimal == "," and "." in cell):
        return float(text)
    actual = f"{shown(column)} is '{shown(cell)}'"
    raise InputError(
        f"{where}: {actual}; expected a number{_decimal_hint(text, decimal)}, an empty field or nan"
    )


def _decimal_hint(text: str, decimal: str) -> str:
    """What is wrong with the decimal sign of a field, in brackets; "" where that is right."""
    if decimal == ",":
        return " with a decimal comma, as others of the file" if is_number(text) else ""
    return " (decimal point, not comma)" if re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", text, re.I) else ""


def csv_text(rows: Iterable[Iterable[str]]) -> str:
    """Returns rows of fields as the text of a CSV file."""
    stream = io.StringIO(newline="")
    csv.writer(stream).writerows(rows)
    return stream.getvalue()
