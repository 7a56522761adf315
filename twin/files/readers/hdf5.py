"""HDF5 files with h5py: datasets by their path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from twin.files.readers.base import Content, Reader, check_count, columns_of


class Hdf5(Reader):
    """An HDF5 file: a column for each dataset, `group/name`, or field of a table, `group/name.field`."""

    kind = "an HDF5 file"
    suffixes = (".h5", ".hdf5", ".hdf")

    def read(self, path: Path) -> Content:
        h5py = self.library("h5py", "h5py")
        columns: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}

        def visit(name: str, found: Any) -> None:
            if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "biufV" or found.shape is None:
                return
            check_count(found.size)
            values = found[()]
            new = dict(_fields(name, values) if values.dtype.names else columns_of(name, values))
            columns.update(new)
            units.update(dict.fromkeys(new, _unit(found)))

        with h5py.File(path, "r") as file:
            file.visititems(visit)
        return Content(columns, units)


def _fields(name: str, values: np.ndarray) -> Any:
    for key in values.dtype.names or ():
        yield from columns_of(f"{name}.{key}", values[key])


def _unit(found: Any) -> str:
    """The unit of a dataset, where an attribute says it."""
    for key in ("unit", "units", "Unit", "Units"):
        unit = found.attrs.get(key)
        if isinstance(unit, str | bytes):
            return unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    return ""
