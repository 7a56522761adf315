"""Writers of tables, such as runs: one file per format, and its line in the registry."""

from __future__ import annotations

from pathlib import Path

from twin.errors import InputError
from twin.files.whole import is_stream, write_file
from twin.files.writers.base import Columns, Units, Writer
from twin.files.writers.csv import Csv
from twin.files.writers.matlab import Matlab
from twin.files.writers.mcap import Mcap
from twin.files.writers.parquet import Parquet

WRITERS: tuple[Writer, ...] = (Csv(), Matlab(), Parquet(), Mcap())

SUFFIXES = tuple(suffix for writer in WRITERS for suffix in writer.suffixes if suffix)
"""Endings of the names of tables; a name without ending is that of a CSV file."""


def writer_of(path: Path) -> Writer:
    """Returns the writer of the format that the ending of a file tells.

    Raises:
      InputError: there is none.
    """
    suffix = "" if is_stream(path) else path.suffix.lower()
    found = next((writer for writer in WRITERS if suffix in writer.suffixes), None)
    if found is None:
        raise InputError(f"{path} ends in '{path.suffix}'; expected one of: {', '.join(SUFFIXES)}")
    return found


def check_table(path: Path | None) -> None:
    """Makes sure, before the work begins, that a table can be written; None for one that is not.

    Raises:
      InputError: there is no such format, or its library is not installed.
    """
    if path is not None:
        writer_of(path).check()


def write_table(columns: Columns, units: Units, path: Path) -> None:
    """Writes columns of equal length, `time` [s] first, in the format that the ending of the file tells.

    Raises:
      InputError: there is no such format, its library is not installed, or the path cannot be written.
    """
    write_file(path, writer_of(path).content(columns, units))
