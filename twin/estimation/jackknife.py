"""Standard errors that grow where recordings contradict each other by more than their noise.

The influence of each recording on the estimate is compared with what its noise explains (infinitesimal jackknife:
L. A. Jaeckel, 1972). Where a rig is not quite the model, the influences are larger, and the standard errors are
multiplied by the root of that ratio (R. T. Birge, 1932). Influences that noise explains leave the sandwich standard
errors unchanged, where those of a plain jackknife would scatter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from twin.estimation import sandwich
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench

_SIGNIFICANCE = 0.05  # probability below which influences as large are not taken for noise


def with_jackknife_covariance(bench: Workbench, base: Fit) -> Fit:
    """The fit with its sandwich covariance, inflated where recordings contradict each other."""
    per_recording = sandwich.recording_information(bench, base)
    covariance = inflated_covariance(
        per_recording.noise_covariance,
        per_recording.prior_covariance,
        *per_recording.influences(),
        largest_errors(base),
    )
    return replace(base, covariance=covariance)


def largest_errors(base: Fit) -> np.ndarray:
    """Upper limit (p) of the standard errors: prior deviation and distance from its mean, in quadrature."""
    return np.array(
        [
            np.hypot(u.scale, value - u.start) if u.prior else np.inf
            for u, value in zip(base.unknowns, base.values, strict=True)
        ]
    )


def inflated_covariance(
    noise: np.ndarray, rest: np.ndarray, influences: np.ndarray, variances: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """Covariance (p x p) with the part due to noise inflated by the scatter of k recordings; correlations are kept.

    Args:
      noise: part of the covariance that is due to noise (p x p).
      rest: other parts (p x p), of which the scatter of recordings tells nothing.
      influences: of each recording on the estimate (k x p).
      variances: of these by noise (k x p).
      most: upper limit of the standard errors (p), see `largest_errors`.
    """
    squares, expected = (influences**2).sum(axis=0), variances.sum(axis=0)
    ratio = np.divide(squares, expected, out=np.ones_like(squares), where=expected > 0)
    # Effective degrees of freedom of a sum of unequal variances (F. E. Satterthwaite, 1946).
    freedom = np.divide(expected**2, (variances**2).sum(axis=0), out=np.ones_like(ratio), where=expected > 0)
    ratio = np.where(ratio * freedom > chi2.isf(_SIGNIFICANCE, freedom), ratio, 1.0)
    covariance = noise + rest
    own = np.sqrt(np.diag(covariance))
    wide = np.sqrt(ratio * np.diag(noise) + np.diag(rest))
    factor = np.divide(np.clip(wide, own, np.maximum(most, own)), own, out=np.ones_like(own), where=own > 0)
    return covariance * np.outer(factor, factor)
