"""The variables of a file of MATLAB 7.3, an HDF5 file, as dicts, lists, texts and arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from twin.errors import InputError, shown
from twin.files.readers.base import check_count

_DEEPEST = 20  # structures in structures; a link may lead back to one above
_MOST_ELEMENTS = 10_000  # of a cell array or an array of structures
_PLAIN = frozenset(
    [
        "double",
        "single",
        "logical",
        "int8",
        "uint8",
        "int16",
        "uint16",
        "int32",
        "uint32",
        "int64",
        "uint64",
        "char",
        "cell",
        "struct",
    ]
)


@dataclass(frozen=True)
class Opaque:
    """An object of a class of MATLAB, of which only MATLAB can make sense."""

    kind: str


def variables(h5py: ModuleType, path: Path) -> dict[str, Any]:
    """Returns the variables of a file, name -> value."""
    with h5py.File(path, "r") as file:
        return {name: _value(h5py, file, file[name], 0) for name in file if not name.startswith("#")}


def _value(h5py: ModuleType, file: Any, found: Any, depth: int) -> Any:
    if depth > _DEEPEST:
        raise InputError(f"{shown(found.name)} is nested more than {_DEEPEST} deep")
    kind = _class(found)
    if kind not in ("", *_PLAIN) or "MATLAB_object_decode" in found.attrs:
        return Opaque(kind or "an object")
    if isinstance(found, h5py.Group):
        fields = {key: _value(h5py, file, entry, depth + 1) for key, entry in found.items()}
        return _array_of_structures(fields) if fields and _of_references(h5py, found) else fields
    check_count(found.size or 0)
    if found.dtype == h5py.ref_dtype:
        if found.size > _MOST_ELEMENTS:
            raise InputError(
                f"{shown(found.name)} has {found.size} elements; expected at most {_MOST_ELEMENTS}"
            )
        return [_value(h5py, file, file[to], depth + 1) for to in found[()].T.ravel() if to]
    if found.shape is None or "MATLAB_empty" in found.attrs:
        return ""
    values = found[()]
    # MATLAB stores columns first.
    return _text(values) if kind == "char" else np.asarray(values).T


def _class(found: Any) -> str:
    kind = found.attrs.get("MATLAB_class", b"")
    return kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)


def _of_references(h5py: ModuleType, group: Any) -> bool:
    """Whether a structure is an array of structures, whose fields are references to those of its elements."""
    return all(
        isinstance(entry, h5py.Dataset) and entry.dtype == h5py.ref_dtype and _class(entry) != "cell"
        for entry in group.values()
    )


def _array_of_structures(fields: dict[str, list[Any]]) -> list[dict[str, Any]]:
    count = min(len(values) for values in fields.values())
    return [{key: values[k] for key, values in fields.items()} for k in range(count)]


def _text(values: np.ndarray) -> str:
    return "".join(chr(code) for code in values.ravel(order="F") if 0 < code < 0xD800)
