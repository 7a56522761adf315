"""CSV files of numbers: a fast reader, and a slow one that reports errors with line and column."""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from twin.errors import LARGEST, InputError, shown
from twin.files.text import check_lines, read_text

_MISSING = ("", "nan")  # fields of a missing sample, lower case
_LARGEST = 1_000_000_000  # bytes: three hours at 1 kHz with ten columns of ten characters
_LONGEST_LINE = 1_000_000  # characters
_MOST_COLUMNS = 10_000  # a card has some hundreds of channels


@dataclass(frozen=True)
class Table:
    """Columns of one CSV file.

    Attributes:
      name: name of the file in messages.
      header: all columns of the file, in order, also those that were not read.
      columns: name -> (n) values; NaN where a sample is missing.
      lines: (n) number of each row's line in the file.
    """

    name: str
    header: tuple[str, ...]
    columns: Mapping[str, np.ndarray] = field(repr=False)
    lines: np.ndarray = field(repr=False)

    def __len__(self) -> int:
        return len(self.lines)


def read_table(path: Path, name: str, wanted: Collection[str] | None = None) -> Table:
    """Reads a CSV file: one header line, comma as separator, decimal point, UTF-8.

    Args:
      path: the file.
      name: name of the file in messages.
      wanted: columns to read, as far as the file has them; None for all. Other columns need not be numbers.

    Raises:
      InputError: the file cannot be read as such a table.
    """
    try:
        return _parsed(_text(path, name), name, wanted)
    except MemoryError:
        raise InputError(f"{name} does not fit into the memory; expected a shorter file") from None


def _text(path: Path, name: str) -> str:
    text = read_text(path, name, _LARGEST, "a CSV file")
    check_lines(text, name, _LONGEST_LINE)
    return text


def _parsed(text: str, name: str, wanted: Collection[str] | None) -> Table:
    """Returns the table in a text; see `read_table`."""
    lines = text.split("\n")
    header = _header(lines[0], name)
    used = [i for i, column in enumerate(header) if wanted is None or column in wanted]
    rows = np.array([i + 2 for i, line in enumerate(lines[1:]) if line.strip()], dtype=int)
    body = [lines[i - 1] for i in rows]
    values = _fast(body, len(header), used)
    if values is None:
        values = np.array(list(_slow(body, rows, header, used, name))).reshape(len(body), len(used))
    columns = {header[i]: values[:, j] for j, i in enumerate(used)}
    return Table(name, header, columns, rows)


def _header(line: str, name: str) -> tuple[str, ...]:
    """Returns the names of the columns; raises InputError where the line is no valid header."""
    if not line.strip():
        raise InputError(f"{name}, line 1 is empty; expected a header line with the names of the columns")
    for other, called in ((";", "semicolons"), ("\t", "tabs")):
        if line.count(other) > line.count(","):
            raise InputError(
                f"{name}, line 1: columns are separated by {called}; expected commas, with a decimal point"
            )
    header = tuple(cell.strip() for cell in _cells(line, f"{name}, line 1"))
    if all(_is_number(cell) for cell in header):
        raise InputError(
            f"{name}, line 1 is '{shown(line)}'; expected a header line with the names of the columns"
        )
    if len(header) > _MOST_COLUMNS:
        raise InputError(f"{name}, line 1 has {len(header)} columns; expected at most {_MOST_COLUMNS}")
    twice = [column for column, count in Counter(header).items() if column and count > 1]
    if twice:
        raise InputError(f"{name}, line 1: column '{shown(twice[0])}' occurs twice; expected each name once")
    return header


def _fast(body: list[str], width: int, used: list[int]) -> np.ndarray | None:
    """Returns the used columns (n, k), or None where a line is irregular in any way."""
    if not body or not used or {line.count(",") for line in body} != {width - 1}:
        return None
    text = "\n".join(body)
    if ",," in text or ",\n" in text or "\n," in text or text[0] == "," or text[-1] == ",":
        body = [_fill(line) for line in body]
    try:
        values = np.loadtxt(body, delimiter=",", comments=None, usecols=used, ndmin=2)
    except ValueError:
        return None
    return None if (np.abs(values) > LARGEST).any() else values


def _fill(line: str) -> str:
    """Returns a line with "nan" in empty fields."""
    # The first replacement misses every second of several empty fields in a row.
    filled = f",{line},".replace(",,", ",nan,").replace(",,", ",nan,")
    return filled[1:-1]


def _slow(
    body: list[str], rows: np.ndarray, header: tuple[str, ...], used: list[int], name: str
) -> Iterator[list[float]]:
    """Yields the used fields of each row; raises InputError with line and column."""
    for line, row in zip(body, rows, strict=True):
        cells = _cells(line, f"{name}, line {row}")
        if len(cells) != len(header):
            raise InputError(f"{name}, line {row} has {_ragged(cells, len(header))}")
        yield [_number(cells[i], header[i], f"{name}, line {row}") for i in used]


def _cells(line: str, where: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except csv.Error as error:
        raise InputError(f"{where}: {error}; expected comma-separated numbers") from None


def _ragged(cells: list[str], width: int) -> str:
    # Decimal commas, 1,5 for 1.5, double the number of fields that are no whole numbers.
    doubled = width < len(cells) <= 2 * width and all(_is_number(cell) for cell in cells)
    hint = "; if the comma is the decimal sign, write a decimal point" if doubled else ""
    return f"{len(cells)} fields; expected {width}, as in the header{hint}"


def _number(cell: str, column: str, where: str) -> float:
    text = cell.strip()
    if text.lower() in _MISSING:
        return math.nan
    if _is_number(text):
        return float(text)
    hint = " (decimal point, not comma)" if re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", text, re.I) else ""
    actual = f"{shown(column)} is '{shown(cell)}'"
    raise InputError(f"{where}: {actual}; expected a number{hint}, an empty field or nan")


def _is_number(cell: str) -> bool:
    try:
        return abs(float(cell)) <= LARGEST and "_" not in cell
    except ValueError:
        return False


def csv_text(rows: Iterable[Iterable[str]]) -> str:
    """Returns rows of fields as the text of a CSV file."""
    stream = io.StringIO(newline="")
    csv.writer(stream).writerows(rows)
    return stream.getvalue()
