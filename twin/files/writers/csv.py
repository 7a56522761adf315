"""Text tables separated by commas."""

from __future__ import annotations

from twin.files.table import csv_text
from twin.files.writers.base import Columns, Units, Writer


class Csv(Writer):
    """A CSV file: names in a header, then a line for each sample."""

    kind = "a CSV file"
    suffixes = (".csv", ".txt", ".dat", ".asc", "")

    def content(self, columns: Columns, units: Units) -> str:
        # 9 digits resolve 1e-8 rad of a turn, far below any sensor.
        rows = ([f"{value:.9g}" for value in row] for row in zip(*columns.values(), strict=True))
        return csv_text([columns, *rows])
