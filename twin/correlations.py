"""Correlations of the errors of fitted parameters: those of length and stiffness of a link are seldom independent.

In a parameter file:

[correlations]
of = ["bending_stiffness", "length", "cable-torsion.stiffness"]
matrix = [[1.0, 0.93, -0.1], [0.93, 1.0, 0.0], [-0.1, 0.0, 1.0]]
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.errors import InputError, shown

_DIGITS = 4  # significant, of a written matrix
_ROUNDING = 1e-3  # error that rounding to a few digits may cause


@dataclass(frozen=True, eq=False)
class Correlations:
    """Correlation matrix of the errors of some parameters.

    Attributes:
      names: rig parameters, or effect.parameter (n).
      matrix: symmetric with ones on its diagonal (n x n).
    """

    names: tuple[str, ...] = ()
    matrix: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    def root(self, names: Sequence[str]) -> np.ndarray:
        """A root S (n x n) of the correlation matrix S S' of these parameters; unknown ones are independent."""
        whole = np.eye(len(names))
        known = [(i, self.names.index(name)) for i, name in enumerate(names) if name in self.names]
        if known:
            rows, own = (list(part) for part in zip(*known, strict=True))
            whole[np.ix_(rows, rows)] = self.matrix[np.ix_(own, own)]
        values, vectors = np.linalg.eigh(whole)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return root / np.linalg.norm(root, axis=1, keepdims=True)

    def lines(self) -> Iterator[str]:
        """Lines of the table in a parameter file; none with fewer than two parameters."""
        if len(self.names) > 1:
            rows = [
                ", ".join(f"{value:.{_DIGITS}g}" for value in row) for row in np.round(self.matrix, _DIGITS)
            ]
            yield from (
                "",
                "[correlations]  # of the errors",
                f"of = {json.dumps(list(self.names))}",
                "matrix = [",
            )
            yield from (f"  [{row}]," for row in rows)
            yield "]"


def from_covariance(names: Sequence[str], covariance: np.ndarray) -> Correlations:
    """The correlations in a covariance (n x n); parameters without a positive, finite variance are left out."""
    variance = np.diag(covariance)
    known = np.flatnonzero(np.isfinite(variance) & (variance > 0))
    deviation = np.sqrt(variance[known])
    matrix = covariance[np.ix_(known, known)] / np.outer(deviation, deviation)
    np.fill_diagonal(matrix, 1.0)
    return Correlations(tuple(names[int(k)] for k in known), np.clip(matrix, -1.0, 1.0))


def read(table: Mapping[str, Any], known: Collection[str]) -> Correlations:
    """The correlations in a table of a parameter file.

    Args:
      table: with `of` and `matrix`, or empty.
      known: names of parameters that can be correlated.

    Raises:
      InputError: the table is not a correlation matrix of such parameters.
    """
    if not table:
        return Correlations()
    names, rows = table.get("of"), table.get("matrix")
    if set(table) != {"of", "matrix"} or not isinstance(names, list):
        raise InputError("correlations: expected of = [names] and matrix = [rows]")
    unknown = [name for name in names if name not in known]
    if unknown or len(set(names)) < len(names):
        what = f"'{shown(str(unknown[0]))}' is no number of the rig" if unknown else "a name stands twice"
        raise InputError(f"correlations.of: {what}; expected each once, of: {', '.join(known)}")
    return Correlations(tuple(names), _matrix(rows, len(names)))


def _matrix(rows: Any, count: int) -> np.ndarray:
    """A correlation matrix (count x count) from rows of a file; raises as `read`."""
    shaped = isinstance(rows, list) and all(isinstance(row, list) and len(row) == count for row in rows)
    if not shaped or len(rows) != count or not all(_is_number(v) for row in rows for v in row):
        raise InputError(f"correlations.matrix: expected {count} rows of {count} numbers from -1 to 1")
    matrix = np.array(rows, dtype=float)
    if np.abs(matrix - matrix.T).max() > _ROUNDING or np.abs(np.diag(matrix) - 1).max() > _ROUNDING:
        raise InputError("correlations.matrix is not symmetric with ones on its diagonal")
    least = float(np.linalg.eigvalsh(matrix).min())
    if least < -count * _ROUNDING:
        raise InputError(
            f"correlations.matrix has the eigenvalue {least:.2g}; expected none below 0: no errors go together so"
        )
    return matrix


def _is_number(value: Any) -> bool:
    """Whether a value of a file is a number from -1 to 1."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and abs(value) <= 1
    )
