"""Bayesian evidence of an unknown smooth function in linearised data: a Gaussian process on evenly spaced knots.

The evidence is the marginal likelihood with the function over the likelihood without it (C. E. Rasmussen and
C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, eq. 5.8). It penalises a function that could have
been larger or more wiggly, so that no number of parameters has to be chosen.

The values f (k) of the function at the knots enter the negative log likelihood as g' f + f' H f / 2, with the gradient
g (k) and the information H (k x k). Their prior is normal with mean 0 and covariance size^2 R R', see `_prior_root`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.residuals.numerics import ROUNDING

LENGTH_SCALES = (0.4, 0.2, 0.1, 0.05)
"""Length scales of the function that are tried, relative to the range of its variable."""
AMPLITUDES = np.geomspace(0.1, 300.0, 15)
"""Prior standard deviations of the function that are tried, relative to the standard error of the value at one knot."""


@dataclass(frozen=True, eq=False)
class FunctionEvidence:
    """Log evidence of a smooth function, maximised over its length scale and amplitude.

    Attributes:
      value: of the data [nat].
      by_draw: of d permuted data sets (d), each maximised by itself [nat].
      length, size: length scale and amplitude that maximise the evidence of the data.
    """

    value: float
    by_draw: np.ndarray
    length: float
    size: float


def maximise_evidence(
    information: np.ndarray, gradient: np.ndarray, gradients: np.ndarray
) -> FunctionEvidence:
    """The log evidence of a function, maximised over `LENGTH_SCALES` and `AMPLITUDES`.

    Args:
      information: of the values at the knots (k x k).
      gradient: of the negative log likelihood of the data (k).
      gradients: of permuted data sets (d x k).
    """
    alone = np.median(np.maximum(np.diag(information), ROUNDING * information.trace())) ** -0.5
    both = np.vstack([gradient, gradients])
    best, length, size = np.full(len(both), -np.inf), LENGTH_SCALES[0], alone
    for scale in LENGTH_SCALES:
        root = _prior_root(len(gradient), scale)
        strengths, axes = np.linalg.eigh(root.T @ information @ root)
        strengths, along = np.maximum(strengths, 0.0), both @ root @ axes
        for amplitude in alone * AMPLITUDES:
            shrunk = amplitude**2 / (1 + amplitude**2 * strengths)
            evidence = 0.5 * along**2 @ shrunk - 0.5 * np.log1p(amplitude**2 * strengths).sum()
            if evidence[0] > best[0]:
                length, size = scale, amplitude
            best = np.maximum(best, evidence)
    return FunctionEvidence(float(best[0]), best[1:], length, float(size))


def posterior_mean(information: np.ndarray, gradient: np.ndarray, length: float, size: float) -> np.ndarray:
    """Posterior mean of the function at the knots (k).

    Args:
      information: of the values at the knots (k x k).
      gradient: of the negative log likelihood of the data (k).
      length, size: length scale and amplitude, as in `FunctionEvidence`.
    """
    root = size * _prior_root(len(gradient), length)
    return -root @ np.linalg.solve(np.eye(len(gradient)) + root.T @ information @ root, root.T @ gradient)


def _prior_root(count: int, length: float) -> np.ndarray:
    """Cholesky factor R (k x k) of a squared-exponential covariance at evenly spaced knots, unit amplitude."""
    place = np.linspace(0, 1, count)
    covariance = np.exp(-0.5 * ((place[:, None] - place) / length) ** 2)
    return np.linalg.cholesky(covariance + 1e-6 * np.eye(count))
