"""Parquet files with pyarrow."""

from __future__ import annotations

import io

from twin.files.writers.base import Columns, Units, Writer


class Parquet(Writer):
    """A Parquet file; the unit of a column stands in its metadata."""

    kind = "a Parquet file"
    suffixes = (".parquet", ".pq")

    def check(self) -> None:
        self.library("pyarrow.parquet", "pyarrow")

    def content(self, columns: Columns, units: Units) -> bytes:
        arrow = self.library("pyarrow", "pyarrow")
        parquet = self.library("pyarrow.parquet", "pyarrow")
        fields = [
            arrow.field(name, arrow.float64(), metadata={"unit": units[name]} if name in units else None)
            for name in columns
        ]
        arrays = [arrow.array(values, arrow.float64()) for values in columns.values()]
        stream = io.BytesIO()
        parquet.write_table(arrow.table(arrays, schema=arrow.schema(fields)), stream)
        return stream.getvalue()
