"""The result of a fit: model, values, covariance and Jacobian."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.estimation.unknowns import Key, Unknown
from twin.mechanics.state import Start
from twin.rigs.model import Model


@dataclass(frozen=True)
class Fit:
    """A model fitted to recordings; p unknowns, n residuals, g blocks of residuals.

    Attributes:
      model: the model at the fitted values.
      starts: the initial state of each recording at the fitted values.
      unknowns: what was fitted (p).
      values: fitted values (p), in the unit of each parameter or its reciprocal (`Unknown.inverse`).
      covariance: of the values (p x p).
      residual: measured minus simulated (n), whitened and in multiples of the noise's standard deviation.
      size: root mean square of the residual in each block (g).
      cost: negative log posterior up to a constant: loss of the blocks plus Gaussian priors.
      jacobian: derivative of the residual by the values (n x p).
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
        """Standard errors of the values (p)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def jacobian_columns(self) -> dict[Key, np.ndarray]:
        """`Unknown.key` -> column of the Jacobian (n)."""
        return {u.key: self.jacobian[:, j] for j, u in enumerate(self.unknowns)}
