"""A fitted model, and how well the data determine it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.estimation.unknowns import Key, Unknown
from twin.mechanics.state import Start
from twin.rigs.model import Model


@dataclass(frozen=True)
class Fit:
    """A model at its best, and how well the data determine it.

    Attributes:
      model: the fitted model.
      starts: state of each recording at its first sample.
      unknowns: what was fitted (p).
      values, errors: (p) and their standard errors.
      covariance: (p x p).
      residual: (n) in noise units.
      size: (g) root-mean-square of each group.
      cost: what was minimised.
      jacobian: (n x p) of the residual.
    """

    model: Model
    starts: tuple[Start, ...]
    unknowns: tuple[Unknown, ...]
    values: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    size: np.ndarray
    cost: float
    jacobian: np.ndarray = field(repr=False)

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def slopes(self) -> dict[Key, np.ndarray]:
        """`Unknown.key` -> what it changes in the residual (n)."""
        return {u.key: self.jacobian[:, j] for j, u in enumerate(self.unknowns)}
