"""MATLAB files, level 5, with scipy."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from twin.files.writers.base import Columns, Units, Writer

_LONGEST = 31  # characters of a name, in level 5
_UNITS = "units"


class Matlab(Writer):
    """A `.mat` file: a vector for each column, and the structure `units`."""

    kind = "a MATLAB file"
    suffixes = (".mat",)

    def content(self, columns: Columns, units: Units) -> bytes:
        from scipy.io import savemat

        names = _names(columns)
        variables: dict[str, Any] = {names[column]: np.asarray(v, float) for column, v in columns.items()}
        variables[_UNITS] = {names[column]: unit for column, unit in units.items() if column in names}
        stream = io.BytesIO()
        # The stubs know files by name only.
        savemat(stream, variables, oned_as="column", do_compression=True)  # type: ignore[arg-type]
        return stream.getvalue()


def _names(columns: Columns) -> dict[str, str]:
    """Column -> a name that MATLAB allows, different for each."""
    names: dict[str, str] = {}
    taken = {_UNITS}
    for column in columns:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", column)[:_LONGEST]
        plain = plain if plain[:1].isalpha() else f"x{plain}"[:_LONGEST]
        number, name = 1, plain
        while name in taken:
            number += 1
            name = f"{plain[: _LONGEST - len(str(number))]}{number}"
        taken.add(name)
        names[column] = name
    return names
