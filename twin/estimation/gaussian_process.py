"""Evidence of a smooth function, a Gaussian process on evenly spaced knots, in linear data.

How much more likely data are with it than without (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for
Machine Learning, 2006, eq. 5.8). Many wiggles cost what they could have been: there is no number of parameters to
choose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SMOOTH = (0.4, 0.2, 0.1, 0.05)
"""Lengths over which the function may change, in the range of its variable."""
SIZES = np.geomspace(0.1, 300.0, 15)
"""Standard deviations that it may have, in what the data tell of one knot's value alone."""
_LEAST = 1e-9  # part of a variance that keeps a matrix regular


@dataclass(frozen=True, eq=False)
class Evidence:
    """How much likelier a function makes data, as a natural logarithm.

    Attributes:
      value: of the data.
      by_draw: (d) of what chance draws instead.
      length, size: of the function, that make the data likeliest.
    """

    value: float
    by_draw: np.ndarray
    length: float
    size: float


def likeliest(information: np.ndarray, gradient: np.ndarray, gradients: np.ndarray) -> Evidence:
    """The evidence of the smoothness and size that make the data, and each draw, likeliest.

    Args:
      information: (k x k) of the knots' values.
      gradient: (k) of the data's log likelihood, its sign turned.
      gradients: (d x k) of the draws'.
    """
    alone = np.median(np.maximum(np.diag(information), _LEAST * information.trace())) ** -0.5
    both = np.vstack([gradient, gradients])
    best, length, size = np.full(len(both), -np.inf), SMOOTH[0], alone
    for smooth in SMOOTH:
        root = _root(len(gradient), smooth)
        strengths, axes = np.linalg.eigh(root.T @ information @ root)
        strengths, along = np.maximum(strengths, 0.0), both @ root @ axes
        for large in alone * SIZES:
            shrunk = large**2 / (1 + large**2 * strengths)
            evidence = 0.5 * along**2 @ shrunk - 0.5 * np.log1p(large**2 * strengths).sum()
            if evidence[0] > best[0]:
                length, size = smooth, large
            best = np.maximum(best, evidence)
    return Evidence(float(best[0]), best[1:], length, float(size))


def likely(information: np.ndarray, gradient: np.ndarray, length: float, size: float) -> np.ndarray:
    """The function (k) that data with this information (k x k) and gradient (k) ask for."""
    root = size * _root(len(gradient), length)
    return -root @ np.linalg.solve(np.eye(len(gradient)) + root.T @ information @ root, root.T @ gradient)


def _root(count: int, length: float) -> np.ndarray:
    """Root (k x k) of the covariance of the function's values at the knots, of size one."""
    place = np.linspace(0, 1, count)
    likeness = np.exp(-0.5 * ((place[:, None] - place) / length) ** 2)
    return np.linalg.cholesky(likeness + 1e-6 * np.eye(count))
