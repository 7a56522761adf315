"""MATLAB files: level 5 with scipy, version 7.3, which is HDF5, with h5py."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import shown
from twin.files.readers import matlab73
from twin.files.readers.base import Content, Reader, check_count, flatten

_HEADER = 128  # bytes of text at the beginning of a file
_OBJECTS = (
    "writetable(timetable2table(x), 'x.csv') saves a timetable as a table, "
    "s = struct('time', x.Time, 'hub', x.Data) a timeseries as a structure"
)


class Matlab(Reader):
    """A `.mat` file: arrays, structures, and what Simulink writes as structures."""

    kind = "a MATLAB file"
    suffixes = (".mat",)

    def read(self, path: Path) -> Content:
        with path.open("rb") as file:
            head = file.read(_HEADER)
        if head.startswith(b"MATLAB 7.3") or head.startswith(b"\x89HDF"):
            return self._version_73(path)
        return _level_5(path)

    def _version_73(self, path: Path) -> Content:
        h5py = self.library("h5py", "h5py (MATLAB 7.3)")
        content = matlab73.variables(h5py, path)
        objects = {name: value.kind for name, value in content.items() if isinstance(value, matlab73.Opaque)}
        return Content(flatten("", content), note=_note(objects))


def _level_5(path: Path) -> Content:
    from scipy.io import loadmat, whosmat

    with suppress(TypeError):  # scipy knows no shape of an object
        check_count(sum(math.prod(shape) for _, shape, _ in whosmat(path)))
    variables = loadmat(path, simplify_cells=True)
    columns: dict[str, np.ndarray] = {}
    objects: dict[str, str] = {}
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if (opaque := _opaque(value)) is not None:
            objects |= opaque
        else:
            columns |= flatten(name, _tree(value))
    return Content(columns, note=_note(objects))


def _opaque(value: Any) -> dict[str, str] | None:
    """Name and class of an object of a class of MATLAB; None where the value is none."""
    fields = getattr(getattr(value, "dtype", None), "names", None) or ()
    if not {"s0", "s2", "arr"} <= set(fields):
        return None
    record = np.atleast_1d(value)[0]
    return {_text(record["s0"]): _text(record["s2"])}


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def _tree(value: Any) -> Any:
    """A value of scipy as dicts, lists and arrays of numbers."""
    if isinstance(value, dict):
        return {key: _tree(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [_tree(entry) for entry in value.ravel()]
    return value


def _note(objects: dict[str, str]) -> str:
    """What could not be read, as the end of a sentence."""
    if not objects:
        return ""
    found = ", ".join(f"{shown(name)} ({shown(kind)})" for name, kind in objects.items())
    return f"; {found} can be read by MATLAB alone: {_OBJECTS}"
