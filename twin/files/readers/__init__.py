"""Readers of recordings: one file per format, and its line in the registry."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from twin.files.readers.base import Reader, read_arrays
from twin.files.readers.excel import Excel
from twin.files.readers.feather import Feather
from twin.files.readers.hdf5 import Hdf5
from twin.files.readers.matlab import Matlab
from twin.files.readers.mcap import Mcap
from twin.files.readers.parquet import Parquet
from twin.files.readers.tdms import Tdms
from twin.files.table import Table, read_table

READERS: tuple[Reader, ...] = (Matlab(), Hdf5(), Parquet(), Feather(), Tdms(), Mcap(), Excel())
"""Readers of files that are no text tables."""

SUFFIXES = (".csv", ".tsv", ".txt", ".dat", ".asc", *(suffix for r in READERS for suffix in r.suffixes))
"""Endings of the names of recordings; a file of any other ending is read as a text table."""


def read_recording(
    path: Path, name: str, wanted: Collection[str] | None = None, numeric_only: bool = False
) -> Table:
    """Reads the columns of a recording, in the format that the ending of its name tells.

    Args:
      path: the file.
      name: name of the file in messages.
      wanted: columns to read, as far as the file has them; None for all columns of the usual length.
      numeric_only: leave out columns of text tables that begin with something else than numbers or instants.

    Raises:
      InputError: the file cannot be read, a wanted column holds no numbers, or those wanted differ in length.
    """
    suffix = path.suffix.lower()
    for reader in READERS:
        if suffix in reader.suffixes:
            return read_arrays(reader, path, name, wanted, numeric_only)
    return read_table(path, name, wanted, numeric_only)
