"""What every writer of tables gets and gives."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

import numpy as np

from twin.files.extras import imported

Columns = Mapping[str, np.ndarray]
"""Name -> (n) values; NaN where a sample is missing."""
Units = Mapping[str, str]
"""Name of a column -> its unit."""


class Writer:
    """A format of tables.

    Attributes:
      kind: the format in words, with its article.
      suffixes: endings of its files, lower case.
    """

    kind: str
    suffixes: tuple[str, ...]

    def check(self) -> None:
        """Raises InputError where a library is not installed."""

    def content(self, columns: Columns, units: Units) -> str | bytes:
        """Returns columns of equal length, `time` [s] first, as a file.

        Raises:
          InputError: a library is not installed.
        """
        raise NotImplementedError

    def library(self, module: str, package: str) -> ModuleType:
        """Imports a library that is no dependency.

        Raises:
          InputError: it is not installed.
        """
        needed = f"{self.kind} is written with {package}"
        return imported(module, needed, "files", ", or write a .csv or .mat file")
