"""How sure a fit is of its values where recordings disagree by more than their noise.

Each recording is left out in turn; where the errors that this gives are larger than those of the noise, they are taken
(B. Efron and C. Stein, 1981). Steps without a recording are straight ones, from the information that it gave.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin import scatter
from twin.fit import Fit, Workbench


def sure(bench: Workbench, base: Fit) -> Fit:
    """The fit with the covariance of its residuals as they are, and at least the errors of the jackknife."""
    said = scatter.evidence(bench, base)
    moves, _ = said.moves()
    without = left_out(base, moves, said.influences())
    return replace(base, covariance=widened(said.covariance, without, most(base)))


def left_out(base: Fit, moves: np.ndarray, influences: np.ndarray) -> np.ndarray:
    """The estimate (k x p) without each recording.

    A step that leaves the range of the parameters is too long to be a straight one: it says no more than its
    direction, and what there is of it at once is taken (the infinitesimal jackknife: L. A. Jaeckel, 1972).

    Args:
      base: the fit.
      moves: (k x p) by a straight step without the recording.
      influences: (k x p) by the recording's weight.
    """
    low, high = np.array([u.bounds for u in base.unknowns]).T
    far = base.values + moves
    inside = ((far >= low) & (far <= high)).all(axis=1, keepdims=True)
    return np.clip(np.where(inside, far, base.values + influences), low, high)


def most(base: Fit) -> np.ndarray:
    """Error (p) of an estimate of which nothing is known but its declaration, and that it lies off it."""
    return np.array(
        [
            np.hypot(u.scale, value - u.start) if u.prior else np.inf
            for u, value in zip(base.unknowns, base.values, strict=True)
        ]
    )


def widened(covariance: np.ndarray, without: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The covariance (p x p), the jackknife's errors where these are larger.

    A rig that is not quite the model makes recordings differ by more than their noise. A few of them cannot prove it,
    but an error that leaves it out is too small.

    Args:
      covariance: (p x p) by the noise.
      without: (k x p) the estimate without each recording.
      most: (p) that the recordings can make an error.
    """
    spread = np.minimum(np.sqrt((len(without) - 1) * without.var(axis=0)), most)
    own = np.sqrt(np.diag(covariance))
    factor = np.maximum(1.0, np.divide(spread, own, out=np.ones_like(own), where=own > 0))
    return covariance * np.outer(factor, factor)
