"""Excel files with openpyxl: a sheet is read as a text table is."""

from __future__ import annotations

import datetime
import zipfile
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

from twin.errors import InputError
from twin.files.readers.base import Reader, check_count
from twin.files.table import Table, csv_text, parse_table

_EPOCH = datetime.datetime(1970, 1, 1)


class Excel(Reader):
    """An Excel file: the first sheet with two rows or more; dates and times of day count in s."""

    kind = "an Excel file"
    suffixes = (".xlsx", ".xlsm")

    def table(self, path: Path, name: str, wanted: Collection[str] | None, numeric_only: bool) -> Table:
        openpyxl = self.library("openpyxl", "openpyxl")
        with zipfile.ZipFile(path) as archive:
            check_count(sum(part.file_size for part in archive.infolist()) // 8)
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        try:
            text = next((t for sheet in book.worksheets if (t := _text(sheet)).count("\n") > 1), None)
        finally:
            book.close()
        if text is None:
            raise InputError(f"{name} has no sheet with two rows; expected a table")
        return replace(parse_table(text, name, wanted, numeric_only), rows="row")


def _text(sheet: Any) -> str:
    """The values of a sheet as a CSV text."""
    sheet.reset_dimensions()  # what the file says of its size need not be true
    rows: list[list[str]] = []
    count = 0
    for row in sheet.iter_rows(values_only=True):
        check_count(count := count + len(row))
        rows.append([_cell(value) for value in row])
    width = max((len(row) for row in rows), default=0)
    padded = ([*row, *[""] * (width - len(row))] if any(row) else [] for row in rows)
    return csv_text(padded).replace("\r\n", "\n").rstrip("\n") + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, bool | int | float):
        return repr(float(value))
    if isinstance(value, datetime.datetime):
        return value.isoformat()
    if isinstance(value, datetime.time):
        return repr((datetime.datetime.combine(_EPOCH, value.replace(tzinfo=None)) - _EPOCH).total_seconds())
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return "" if value is None else " ".join(str(value).split())
