"""How sure a fit is of its values where recordings disagree by more than their noise.

Each recording is given a little less weight in turn (the infinitesimal jackknife: L. A. Jaeckel, 1972). A rig that is
not quite the model makes the estimate move by more than the noise does: its errors grow in that proportion
(R. T. Birge, 1932). Moves that the noise explains leave them as they are; the jackknife's own errors would not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from twin.estimation import sandwich
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench

_CHANCE = 0.05  # of moves as large as these by the noise alone, up to which it is not taken to explain them


def sure(bench: Workbench, base: Fit) -> Fit:
    """The fit with the covariance of its residuals as they are, and of recordings as far apart as they are."""
    said = sandwich.evidence(bench, base)
    covariance = widened(said.by_noise, said.by_declaration, *said.influences(), most(base))
    return replace(base, covariance=covariance)


def most(base: Fit) -> np.ndarray:
    """Error (p) of an estimate of which nothing is known but its declaration, and that it lies off it."""
    return np.array(
        [
            np.hypot(u.scale, value - u.start) if u.prior else np.inf
            for u, value in zip(base.unknowns, base.values, strict=True)
        ]
    )


def widened(
    noise: np.ndarray, rest: np.ndarray, influences: np.ndarray, variances: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """The covariance (p x p) with errors as much larger as recordings lie further apart than their noise.

    Args:
      noise: (p x p) what the noise of the recordings adds to it.
      rest: (p x p) what else does: recordings that disagree say nothing of that.
      influences: (k x p) of each recording on the estimate.
      variances: (k x p) of these by the noise.
      most: (p) that the recordings can make an error.
    """
    squares, expected = (influences**2).sum(axis=0), variances.sum(axis=0)
    ratio = np.divide(squares, expected, out=np.ones_like(squares), where=expected > 0)
    # So many recordings, all alike, would scatter as those that speak (F. E. Satterthwaite, 1946).
    alike = np.divide(expected**2, (variances**2).sum(axis=0), out=np.ones_like(ratio), where=expected > 0)
    ratio = np.where(ratio * alike > chi2.isf(_CHANCE, alike), ratio, 1.0)
    covariance = noise + rest
    own = np.sqrt(np.diag(covariance))
    wide = np.sqrt(ratio * np.diag(noise) + np.diag(rest))
    factor = np.divide(np.clip(wide, own, np.maximum(most, own)), own, out=np.ones_like(own), where=own > 0)
    return covariance * np.outer(factor, factor)
