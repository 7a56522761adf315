"""Parquet files with pyarrow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from twin.files.readers.base import Content, Reader, check_count


class Parquet(Reader):
    """A Parquet file: its columns."""

    kind = "a Parquet file"
    suffixes = (".parquet", ".pq")

    def read(self, path: Path) -> Content:
        parquet = self.library("pyarrow.parquet", "pyarrow")
        with parquet.ParquetFile(path) as file:
            check_count(file.metadata.num_rows * file.metadata.num_columns)
            return arrow_content(file.read())


def arrow_content(table: Any) -> Content:
    """Returns the columns of an Arrow table; missing numbers as NaN."""
    columns = {name: _array(table[name]) for name in table.column_names}
    described = {f.name: f.metadata or {} for f in table.schema}
    units = {
        name: m.get(b"unit", m.get(b"units", b"")).decode("utf-8", "replace") for name, m in described.items()
    }
    return Content(columns, units)


def _array(column: Any) -> np.ndarray:
    values = column.to_numpy()
    if values.dtype == object and str(column.type).startswith(("bool", "decimal")):
        return np.array([np.nan if value is None else float(value) for value in values])
    return values
