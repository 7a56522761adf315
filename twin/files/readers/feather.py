"""Feather files, of Arrow, with pyarrow."""

from __future__ import annotations

from pathlib import Path

from twin.files.readers.base import Content, Reader, check_count
from twin.files.readers.parquet import arrow_content


class Feather(Reader):
    """A Feather file: its columns."""

    kind = "a Feather file"
    suffixes = (".feather", ".arrow")

    def read(self, path: Path) -> Content:
        feather = self.library("pyarrow.feather", "pyarrow")
        table = feather.read_table(path)
        check_count(table.num_rows * table.num_columns)
        return arrow_content(table)
