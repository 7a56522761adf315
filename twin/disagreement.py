"""How sure a fit is of its values where recordings disagree by more than their noise.

Each recording is left out in turn. A rig that is not quite the model makes the estimate move by more than the noise
does: its errors grow in that proportion (R. T. Birge, 1932). Moves that the noise explains leave them as they are,
however unevenly the recordings speak of a parameter; the jackknife's own errors would not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from twin import scatter
from twin.fit import Fit, Workbench

_CHANCE = 0.05  # of moves as large as these by the noise alone, up to which it is not taken to explain them


def sure(bench: Workbench, base: Fit) -> Fit:
    """The fit with the covariance of its residuals as they are, and of recordings as far apart as they are."""
    said = scatter.evidence(bench, base)
    return replace(base, covariance=widened(said.covariance, said.distances(), most(base)))


def most(base: Fit) -> np.ndarray:
    """Error (p) of an estimate of which nothing is known but its declaration, and that it lies off it."""
    return np.array(
        [
            np.hypot(u.scale, value - u.start) if u.prior else np.inf
            for u, value in zip(base.unknowns, base.values, strict=True)
        ]
    )


def widened(covariance: np.ndarray, distances: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The covariance (p x p) with errors as much larger as recordings lie further apart than their noise.

    Args:
      covariance: (p x p) by the noise.
      distances: (k x p) by which the estimate moves without each recording, in standard errors of the move; 0 where a
        recording says nothing.
      most: (p) that the recordings can make an error.
    """
    speaking = np.maximum((distances != 0).sum(axis=0), 1)
    squares = (distances**2).sum(axis=0)
    ratio = np.where(squares > chi2.isf(_CHANCE, speaking), np.sqrt(squares / speaking), 1.0)
    own = np.sqrt(np.diag(covariance))
    factor = np.clip(np.divide(most, own, out=np.ones_like(own), where=own > 0), 1.0, ratio)
    return covariance * np.outer(factor, factor)
