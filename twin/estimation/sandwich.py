"""The covariance of a fit whose residuals are not what its weights take them for.

The weights count so many independent samples a second and one size of the noise. In truth it is coloured: the hub's
second derivative makes it grow with the frequency, the link rings with it, and one noise of the hub angle is in all
channels. So the pulls of the residuals on the parameters, J' w r, have another covariance M than the information
H = J' w J + P. It follows from the spectra S of the residuals themselves, which stand for the noise whatever its
colour, and replaces H in the middle, beside the declared uncertainty P (P. J. Huber, 1967):

    H^-1 (M + P) H^-1        M = 1/N sum_f Z(f)* S(f) Z(f)        Z: Fourier transform of w J
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len, rfft

from twin.estimation.fit import Fit
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench
from twin.residuals.data import SINGLE
from twin.residuals.filters import GRID

_SMOOTH = 1.0  # Hz to either side over which a spectrum is averaged
_APART = 2.0  # s of zeros behind a recording, longer than its noise is correlated
_NOTHING = 1e-6  # of a variance, below which a recording says nothing of a parameter


@dataclass(frozen=True)
class Evidence:
    """What the recordings say, each by itself.

    Attributes:
      information: (k x p x p) of each recording, J' w J.
      pulls: (k x p) of each recording at the fit, J' w r.
      scatter: (k x p x p) covariance of the pulls by the noise.
      prior: (p) precision of what was declared.
    """

    information: np.ndarray
    pulls: np.ndarray
    scatter: np.ndarray
    prior: np.ndarray

    @property
    def inverse(self) -> np.ndarray:
        """Inverse of the whole information (p x p)."""
        return _inverse(self.information.sum(axis=0) + np.diag(self.prior))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (p x p) of the estimate."""
        return self.by_noise + self.by_declaration

    @property
    def by_noise(self) -> np.ndarray:
        """What the noise of the recordings adds to the covariance (p x p)."""
        return self.inverse @ self.scatter.sum(axis=0) @ self.inverse

    @property
    def by_declaration(self) -> np.ndarray:
        """What the uncertainty of the declaration adds to the covariance (p x p)."""
        return self.inverse @ np.diag(self.prior) @ self.inverse

    def distances(self) -> np.ndarray:
        """How far (k x p) the estimate moves without each recording, in standard errors of the move.

        0 where the others say nothing. Without recording i it moves by (H - H_i)^-1 g_i. At the estimate its pull is
        g_i = (1 - H_i H^-1) e_i - H_i H^-1 sum_j e_j, with e of each recording and of the priors independent.
        """
        information = self.information.sum(axis=0) + np.diag(self.prior)
        least = _NOTHING * np.diag(self.covariance)
        distances = np.zeros_like(self.pulls)
        for i, (H, V) in enumerate(zip(self.information, self._pull_scatter(), strict=True)):
            rest = _inverse(information - H)
            variance = np.diag(rest @ V @ rest)
            sure = variance > least
            move = rest @ self.pulls[i]
            distances[i] = np.where(sure, move / np.sqrt(np.where(sure, variance, 1.0)), 0.0)
        return distances

    def influences(self) -> tuple[np.ndarray, np.ndarray]:
        """How far (k x p) the estimate moves by a little less of each recording, over that little, and its variance.

        Unlike the move without a recording it never is too long a step for slopes to tell it: H^-1 g_i.
        """
        inverse = self.inverse
        variances = [np.diag(inverse @ V @ inverse) for V in self._pull_scatter()]
        return self.pulls @ inverse, np.array(variances)

    def _pull_scatter(self) -> list[np.ndarray]:
        """Covariance (p x p) of each recording's pull at the estimate."""
        inverse, every = self.inverse, self.scatter.sum(axis=0) + np.diag(self.prior)
        found = []
        for H, M in zip(self.information, self.scatter, strict=True):
            given = H @ inverse
            own = np.eye(len(H)) - given
            found.append(own @ M @ own.T + given @ (every - M) @ given.T)
        return found


def evidence(bench: Workbench, base: Fit) -> Evidence:
    """Reads what each recording says of a fit's parameters, and how surely."""
    w = row_weights(bench, base.residual)
    # The state at the first sample of a recording is nothing to the others, whatever slopes by differences say.
    owner = np.array([-1 if u.recording is None else u.recording for u in base.unknowns])
    count, p = len(bench.prepared), base.jacobian.shape[1]
    information, scatter, pulls = np.zeros((count, p, p)), np.zeros((count, p, p)), np.zeros((count, p))
    for i in range(count):
        mine = [g for g in bench.data.groups if g.recording == i]
        slopes = np.where((owner == -1) | (owner == i), base.jacobian, 0.0)
        for g in mine:
            J = w[g.rows, None] * slopes[g.rows]
            information[i] += slopes[g.rows].T @ J
            pulls[i] += J.T @ base.residual[g.rows]
            if g.channel in SINGLE:
                scatter[i] += slopes[g.rows].T @ J
        rows = [g.rows for g in mine if g.channel not in SINGLE]
        if rows:
            scatter[i] += _scatter(
                np.stack([bench.weight[r] for r in rows], axis=1),
                np.stack([base.residual[r] for r in rows], axis=1),
                np.stack([w[r, None] * slopes[r] for r in rows], axis=1),
            )
    return Evidence(information, pulls, scatter, prior_precision(base.unknowns))


def _scatter(known: np.ndarray, residual: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Covariance (p x p) of the pulls of one recording.

    Args:
      known: (m x c) 1 where a channel is compared, else 0.
      residual: (m x c), 0 where it is not.
      slopes: (m x c x p) weight times slope of the residual.
    """
    size = next_fast_len(len(residual) + int(_APART / GRID), real=True)
    r, z = rfft(residual, size, axis=0), rfft(slopes, size, axis=0)
    common = np.maximum(known.T @ known, 1.0)
    half = max(1, round(_SMOOTH * size * GRID))
    spectra = r[:, :, None] * r.conj()[:, None, :] / common
    smooth = _averaged(spectra, half)
    twice = np.full(len(r), 2.0)
    twice[0] = 1.0
    if size % 2 == 0:
        twice[-1] = 1.0
    return np.einsum("f,fcp,fcd,fdq->pq", twice, z.conj(), smooth, z, optimize=True).real / size


def _averaged(values: np.ndarray, half: int) -> np.ndarray:
    """Means (f, ...) over so many neighbours to either side, as far as there are any."""
    total = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    here = np.arange(len(values))
    low, high = np.maximum(here - half, 0), np.minimum(here + half + 1, len(values))
    return (total[high] - total[low]) / (high - low).reshape(-1, *(1,) * (values.ndim - 1))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of an information (p x p), each parameter in a unit of its own; zero where nothing is said."""
    size = np.sqrt(np.diag(matrix))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    return np.linalg.pinv(matrix * np.outer(unit, unit), hermitian=True) * np.outer(unit, unit)
