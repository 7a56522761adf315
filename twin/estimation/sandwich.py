"""Sandwich covariance of a fit: standard errors that hold for coloured noise.

The information H = J' W J + P treats residuals as independent samples, a fixed number a second, with one size per
block. In fact they are coloured: the second derivative of the hub angle amplifies noise at high frequencies, the link
rings with it, and the noise of the hub angle is in all channels. So the covariance M of the score J' W r is not J' W J.
It is estimated from the cross spectra S of the residuals of one recording, whatever their colour. With the precision P
of the priors, the covariance of the estimate is then (P. J. Huber, 1967)

    H^-1 (M + P) H^-1        M = 1/N sum_f Z(f)* S(f) Z(f)        Z: discrete Fourier transform of W J
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len, rfft

from twin.estimation.fit import Fit
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench
from twin.residuals.filters import GRID
from twin.residuals.residual import EVENT_CHANNELS
from twin.residuals.view import PADDING

_SMOOTHING = 1.0  # Hz to either side over which a spectrum is averaged
_UNINFORMATIVE = 1e-6  # ratio of variances below which a recording has no influence on a parameter


@dataclass(frozen=True)
class RecordingInformation:
    """Information and score of each of k recordings at a fit with p unknowns; recordings are independent.

    Attributes:
      information: J' W J of each recording (k x p x p).
      scores: J' W r of each recording at the fit (k x p).
      score_covariance: covariance of each recording's score by its noise, M above (k x p x p).
      prior: reciprocal variance of each prior (p).
    """

    information: np.ndarray
    scores: np.ndarray
    score_covariance: np.ndarray
    prior: np.ndarray

    @property
    def inverse(self) -> np.ndarray:
        """H^-1, the inverse of the information of all recordings and priors (p x p)."""
        return _inverse(self.information.sum(axis=0) + np.diag(self.prior))

    @property
    def covariance(self) -> np.ndarray:
        """Sandwich covariance of the estimate (p x p)."""
        return self.noise_covariance + self.prior_covariance

    @property
    def noise_covariance(self) -> np.ndarray:
        """Part of the covariance that is due to noise (p x p), H^-1 M H^-1."""
        return self.inverse @ self.score_covariance.sum(axis=0) @ self.inverse

    @property
    def prior_covariance(self) -> np.ndarray:
        """Part of the covariance that is due to the declared uncertainty (p x p), H^-1 P H^-1."""
        return self.inverse @ np.diag(self.prior) @ self.inverse

    def deletion_moves(self) -> np.ndarray:
        """Change of the estimate when a recording is left out (k x p), in standard errors of that change.

        0 where the other recordings do not determine the parameter. Without recording i the estimate changes by
        (H - H_i)^-1 g_i, where g_i is its score at the estimate, g_i = (1 - H_i H^-1) e_i - H_i H^-1 sum_(j != i) e_j,
        with independent errors e of the scores of each recording and of the priors.
        """
        information = self.information.sum(axis=0) + np.diag(self.prior)
        least = _UNINFORMATIVE * np.diag(self.covariance)
        moves = np.zeros_like(self.scores)
        for i, (H, V) in enumerate(zip(self.information, self._scores_at_estimate(), strict=True)):
            rest = _inverse(information - H)
            variance = np.diag(rest @ V @ rest)
            informative = variance > least
            move = rest @ self.scores[i]
            moves[i] = np.where(informative, move / np.sqrt(np.where(informative, variance, 1.0)), 0.0)
        return moves

    def influences(self) -> tuple[np.ndarray, np.ndarray]:
        """Influence of each recording on the estimate, H^-1 g_i (k x p), and its variance by noise (k x p).

        It is the derivative of the estimate by the recording's weight. Unlike the change without the recording it is
        never too large for a linearisation.
        """
        inverse = self.inverse
        variances = [np.diag(inverse @ V @ inverse) for V in self._scores_at_estimate()]
        return self.scores @ inverse, np.array(variances)

    def _scores_at_estimate(self) -> list[np.ndarray]:
        """Covariance (p x p) of each recording's score at the estimate, which depends on all recordings."""
        inverse, every = self.inverse, self.score_covariance.sum(axis=0) + np.diag(self.prior)
        covariances = []
        for H, M in zip(self.information, self.score_covariance, strict=True):
            given = H @ inverse
            own = np.eye(len(H)) - given
            covariances.append(own @ M @ own.T + given @ (every - M) @ given.T)
        return covariances


def recording_information(bench: Workbench, base: Fit) -> RecordingInformation:
    """Information, score and covariance of the score of each recording at a fit."""
    w = row_weights(bench, base.residual)
    # An initial state does not influence other recordings, whatever rounding of differences is in the Jacobian.
    owner = np.array([-1 if u.recording is None else u.recording for u in base.unknowns])
    count, p = len(bench.prepared), base.jacobian.shape[1]
    information, covariance, scores = np.zeros((count, p, p)), np.zeros((count, p, p)), np.zeros((count, p))
    for i in range(count):
        mine = [g for g in bench.data.groups if g.recording == i]
        jacobian = np.where((owner == -1) | (owner == i), base.jacobian, 0.0)
        for g in mine:
            J = w[g.rows, None] * jacobian[g.rows]
            information[i] += jacobian[g.rows].T @ J
            scores[i] += J.T @ base.residual[g.rows]
            if g.channel in EVENT_CHANNELS:
                covariance[i] += jacobian[g.rows].T @ J
        rows = [g.rows for g in mine if g.channel not in EVENT_CHANNELS]
        if rows:
            covariance[i] += _score_covariance(
                np.stack([bench.weight[r] for r in rows], axis=1),
                np.stack([base.residual[r] for r in rows], axis=1),
                np.stack([w[r, None] * jacobian[r] for r in rows], axis=1),
                bench.data.row_period(i),
            )
    return RecordingInformation(information, scores, covariance, prior_precision(base.unknowns))


def _score_covariance(
    known: np.ndarray, residual: np.ndarray, weighted: np.ndarray, period: float
) -> np.ndarray:
    """Covariance (p x p) of the score of one recording with m samples of c channels, by the cross spectra.

    Args:
      known: (m x c) 1 where a channel is compared, else 0.
      residual: (m x c), 0 where it is not.
      weighted: (m x c x p) weight times Jacobian.
      period: time between two samples [s].
    """
    size = next_fast_len(len(residual) + round(PADDING * GRID / period), real=True)
    r, z = rfft(residual, size, axis=0), rfft(weighted, size, axis=0)
    common = np.maximum(known.T @ known, 1.0)
    half = max(1, round(_SMOOTHING * size * period))
    spectra = r[:, :, None] * r.conj()[:, None, :] / common
    smooth = _moving_average(spectra, half)
    # The one-sided spectrum counts twice but for the frequencies 0 and Nyquist.
    twice = np.full(len(r), 2.0)
    twice[0] = 1.0
    if size % 2 == 0:
        twice[-1] = 1.0
    return np.einsum("f,fcp,fcd,fdq->pq", twice, z.conj(), smooth, z, optimize=True).real / size


def _moving_average(values: np.ndarray, half: int) -> np.ndarray:
    """Mean (f, ...) of each value and `half` neighbours to either side, fewer at the ends."""
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    here = np.arange(len(values))
    low, high = np.maximum(here - half, 0), np.minimum(here + half + 1, len(values))
    return (total[high] - total[low]) / (high - low).reshape(-1, *(1,) * (values.ndim - 1))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Pseudo-inverse of an information (p x p), scaled to a unit diagonal first; zero for undetermined parameters."""
    size = np.sqrt(np.diag(matrix))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    return np.linalg.pinv(matrix * np.outer(unit, unit), hermitian=True) * np.outer(unit, unit)
