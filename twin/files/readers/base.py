"""What every reader of a binary format shares: size and errors of the file, and columns made of its arrays."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from twin.errors import LARGEST, InputError, listed, shown
from twin.files.extras import imported
from twin.files.layout import MOST_COLUMNS
from twin.files.table import LARGEST_FILE, Table
from twin.files.text import check_size
from twin.foreign import from_outside, reason

_MOST_NUMBERS = LARGEST_FILE // 8
"""Numbers in a file, which may be compressed, at most: they take as much memory as the largest file."""


@dataclass(frozen=True)
class Content:
    """What a file holds.

    Attributes:
      columns: name -> (n) samples, or an array that is no column of numbers; n may differ.
      units: name -> unit, as far as the file says it.
      note: what could not be read, as the end of a sentence; else "".
    """

    columns: Mapping[str, np.ndarray] = field(repr=False)
    units: Mapping[str, str] = field(default_factory=dict)
    note: str = ""


class Reader:
    """A format of recordings.

    Attributes:
      kind: the format in words, with its article.
      suffixes: endings of its files, lower case.
    """

    kind: str
    suffixes: tuple[str, ...]

    def read(self, path: Path) -> Content:
        """Returns the arrays of a file; may raise anything."""
        raise NotImplementedError

    def table(self, path: Path, name: str, wanted: Collection[str] | None, numeric_only: bool) -> Table:
        """Returns the columns of a file; see `read_recording`. May raise anything."""
        return _table(self.read(path), name, wanted)

    def library(self, module: str, package: str) -> ModuleType:
        """Imports a library that is no dependency.

        Raises:
          InputError: it is not installed.
        """
        needed = f"{self.kind} is read with {package}"
        return imported(module, needed, "files", ", or save the recording as CSV")


def read_arrays(
    reader: Reader, path: Path, name: str, wanted: Collection[str] | None, numeric_only: bool
) -> Table:
    """Returns the columns of a file; see `read_recording`."""
    check_size(path, name, LARGEST_FILE, reader.kind)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return reader.table(path, name, wanted, numeric_only)
    except MemoryError:
        raise InputError(f"{name} does not fit into the memory; expected a shorter file") from None
    except InputError as error:
        raise error if str(error).startswith(name) else InputError(f"{name}: {error}") from None
    except BaseException as error:
        if from_outside(error):
            raise
        raise InputError(f"{name} cannot be read as {reader.kind}: {reason(error)}") from None


def check_count(numbers: int) -> None:
    """Raises InputError where a file holds more numbers than fit into memory."""
    if numbers > _MOST_NUMBERS:
        raise InputError(f"it holds {numbers} numbers; expected at most {_MOST_NUMBERS}")


def _table(content: Content, name: str, wanted: Collection[str] | None) -> Table:
    if len(content.columns) > MOST_COLUMNS:
        raise InputError(f"{name} has {len(content.columns)} columns; expected at most {MOST_COLUMNS}")
    if not content.columns:
        raise InputError(f"{name} holds no arrays of numbers{content.note}")
    used = _usual(content.columns) if wanted is None else [c for c in content.columns if c in wanted]
    columns = {column: _checked(content.columns[column], column, name) for column in used}
    _check_lengths(columns, name)
    length = max((len(values) for values in columns.values()), default=0)
    header = tuple(content.columns)
    units = {column: unit for column, unit in content.units.items() if unit}
    units |= {column: "s" for column in used if content.columns[column].dtype.kind in "mM"}
    return Table(name, header, columns, np.arange(1, length + 1), name, "sample", units, content.note)


def _usual(columns: Mapping[str, np.ndarray]) -> list[str]:
    """Columns of numbers of the length that most have; of two such lengths the larger."""
    numeric = {column: numbers(values) for column, values in columns.items()}
    lengths = Counter(len(values) for values in numeric.values() if values is not None)
    if not lengths:
        return []
    usual = max(lengths, key=lambda n: (lengths[n], n))
    return [column for column, values in numeric.items() if values is not None and len(values) == usual]


def _checked(values: np.ndarray, column: str, name: str) -> np.ndarray:
    found = numbers(values)
    if found is None:
        raise InputError(f"{name}: {shown(column)} holds {_held(values)}; expected numbers")
    wrong = np.flatnonzero(~(np.abs(found) <= LARGEST) & ~np.isnan(found))
    if wrong.size:
        actual = f"{shown(column)} is '{found[wrong[0]]:g}'"
        raise InputError(f"{name}, sample {wrong[0] + 1}: {actual}; expected a number or nan")
    return found


def _held(values: np.ndarray) -> str:
    return "complex numbers" if np.iscomplexobj(values) else "no numbers, but text or objects"


def _check_lengths(columns: Mapping[str, np.ndarray], name: str) -> None:
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1:
        found = listed([f"{column} {count}" for column, count in lengths.items()])
        raise InputError(
            f"{name}: columns differ in their number of samples: {found}; expected as many in each"
        )


def numbers(values: np.ndarray) -> np.ndarray | None:
    """Returns an array (n) as floats, instants in s since the first; None where it holds something else."""
    if values.ndim != 1:
        return None
    if values.dtype.kind in "mM":
        absent = np.isnat(values)
        if absent.all():
            return np.full(len(values), np.nan)
        first = values[~absent][0] if values.dtype.kind == "M" else np.timedelta64(0, "ns")
        return np.where(absent, np.nan, (values - first) / np.timedelta64(1, "s"))
    return values.astype(float) if values.dtype.kind in "biuf" else None


def columns_of(name: str, values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yields the columns of an array with their names: `name`, or `name[0]`, `name[1]` ... of a matrix.

    Samples lie along the longer side. What has one number alone is no column.
    """
    array = np.squeeze(values)
    if array.ndim == 1 and len(array) > 1:
        yield name, array
    if array.ndim > 1:
        across = np.moveaxis(array, int(np.argmax(array.shape)), 0).reshape(max(array.shape), -1)
        if across.shape[1] > MOST_COLUMNS:
            raise InputError(
                f"{shown(name)} has the shape {array.shape}; expected at most {MOST_COLUMNS} columns"
            )
        for k in range(across.shape[1]):
            yield f"{name}[{k}]", across[:, k]


_SAMPLES = ("values", "Values", "Data", "data")
_LABELS = ("label", "Label", "Name", "name")


def flatten(name: str, value: Any) -> dict[str, np.ndarray]:
    """Returns the columns of a nested value: dicts are structures, lists arrays of structures.

    A structure's field is `name.field`, an element of an array `name[0]`, or `name.label` where it has a label, as the
    signals of Simulink and dSPACE have.
    """
    if isinstance(value, Mapping):
        columns: dict[str, np.ndarray] = {}
        for key, entry in value.items():
            columns |= _signals(name, entry) if key == "signals" else flatten(_joined(name, str(key)), entry)
        return columns
    if isinstance(value, list):
        return _elements(name, value)
    return dict(columns_of(name, value)) if isinstance(value, np.ndarray) else {}


def _signals(name: str, entry: Any) -> dict[str, np.ndarray]:
    """Columns of the signals of Simulink's structure, whose labels stand beside its time."""
    elements = entry if isinstance(entry, list) else [entry]
    if not all(isinstance(element, Mapping) and "values" in element for element in elements):
        return flatten(_joined(name, "signals"), entry)
    return _elements(name, elements, _joined(name, "signals"))


def _elements(name: str, elements: list[Any], unlabelled: str | None = None) -> dict[str, np.ndarray]:
    labels = [_label(element) for element in elements]
    columns: dict[str, np.ndarray] = {}
    for k, (element, label) in enumerate(zip(elements, labels, strict=True)):
        own = label and label != "time" and labels.count(label) == 1
        place = _joined(name, label) if own else f"{unlabelled or name}[{k}]"
        columns |= flatten(place, _samples(element))
    return columns


def _label(element: Any) -> str:
    """The label of a structure; "" where it has none."""
    texts = (element.get(key) for key in _LABELS) if isinstance(element, Mapping) else ()
    return next((text.strip() for text in texts if isinstance(text, str) and text.strip()), "")


def _samples(element: Any) -> Any:
    """The samples of a structure that has no other array; else all of it."""
    if not isinstance(element, Mapping):
        return element
    arrays = [k for k, v in element.items() if isinstance(v, np.ndarray) and v.size > 1 and k != "dimensions"]
    lone = [key for key in arrays if key in _SAMPLES]
    return element[lone[0]] if len(arrays) == len(lone) == 1 else element


def _joined(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key
