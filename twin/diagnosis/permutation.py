"""Sign-flip permutation test: the distribution of the best score of a round where no effect is missing.

Null hypothesis: the residuals of the calibrated model are noise and discretisation error, whose sign is independent of
the sign that an effect would give them. Then the sign of each stretch of a recording, all channels together, can be
flipped at random without a change of the distribution. For each draw of signs every candidate is scored by the
linearised model, as in the search: the calibration is free to compensate, and the penalty of the parameters is
subtracted. The statistic of a draw is the largest score of all candidates, so that the test corrects for their number.
The threshold is the (1 - rate) quantile over the draws. It depends on the recordings, channels and residuals of this
campaign and on the library of effects, on no other campaign.

The order of a wave is chosen from a spectrum, which is not computed again for each draw. The largest of n independent
peaks of two coefficients exceeds one of them by log n on average. This is added, multiplied by the level of the
spectrum near the peak in units of white noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.diagnosis.rays import Reached
from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.slopes import kept_beside, prior_precision, row_weights
from twin.estimation.workbench import Workbench
from twin.residuals.numerics import ROUNDING

DRAWS = 400
"""Number of sign patterns; the smallest false-alarm rate is 1/DRAWS."""
SEED = 0
"""Of the signs: a fixed seed makes the threshold reproducible."""
SEEDS: Mapping[str, int] = {"permutation_test": SEED}
"""Use of random numbers in a diagnosis -> seed, for the record of an answer."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """A candidate to first order, for the score test and the permutation test.

    Attributes:
      columns: (n x k) derivative of the residual with respect to each of its parameters, in single precision: those of
        all candidates are the largest arrays of a search.
      replaces: declared parameters that it replaces.
      penalty: of its parameters, see `Workbench.penalty`.
      comparisons: number of peaks of a spectrum from which the columns were chosen.
      spectral_level: level of the spectrum near the peak, in units of white noise.
      coefficients: (k x c) `Effect.linear_coefficients` of each column; empty if the effect has none.
      reached: of each of its `rays`, the length at which a column was taken and the root-mean-square change of the
        residual there [noise levels]; None where there is no column. Empty for a wave.
    """

    columns: np.ndarray
    replaces: tuple[str, ...]
    penalty: float
    comparisons: int = 1
    spectral_level: float = 1.0
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    reached: tuple[Reached | None, ...] = ()


def permutation_scores(
    bench: Workbench, base: Fit, slopes: Mapping[str, Slopes], draws: int = DRAWS, seed: int = SEED
) -> np.ndarray:
    """Largest score of all candidates in each draw (draws), ascending.

    Args:
      bench: the data.
      base: the fit of the model without the candidates.
      slopes: candidate -> its derivatives at this fit.
      draws: number of random sign patterns.
      seed: of the signs.
    """
    signs = random_signs(bench, draws, np.random.default_rng(seed))
    weights = row_weights(bench, base.residual)
    candidates = [c for c in slopes.values() if c.columns.shape[1]]
    replaced = {c.replaces for c in candidates}

    none = np.zeros((len(base.residual), 0))

    def costs(replaces: tuple[str, ...], columns: np.ndarray) -> np.ndarray:
        return _linearised_costs(bench, base, weights, signs, replaces, columns)

    alone = dict(zip(replaced, bench.pool.map(lambda names: costs(names, none), replaced), strict=True))
    largest = np.zeros(draws)
    with_each = bench.pool.map(lambda c: costs(c.replaces, c.columns), candidates)
    for candidate, with_it in zip(candidates, with_each, strict=True):
        selection = candidate.spectral_level * np.log(candidate.comparisons)
        gain = alone[candidate.replaces] - with_it - candidate.penalty + selection
        largest = np.maximum(largest, gain)
    return np.sort(largest)


def threshold(ascending: Sequence[float] | np.ndarray, rate: float) -> float:
    """The (1 - rate) quantile of the draws, rounded up to the next draw."""
    values = np.asarray(ascending)
    return float(values[min(len(values) - 1, int(np.ceil((1 - rate) * len(values))))])


def p_value(ascending: np.ndarray, score: float) -> float:
    """Probability of a score at least as large under the null hypothesis.

    Above the upper tenth of the draws the tail is exponential, with the mean excess of these draws as its scale. The
    scale is at least 1, that of the log-likelihood ratio of one more parameter.

    Args:
      ascending: (d) the draws.
      score: the observed score.
    """
    begin = len(ascending) - max(1, len(ascending) // 10)
    tail = ascending[begin:]
    if score <= tail[0]:
        return float(np.mean(ascending >= score))
    scale = max(1.0, float(np.mean(tail - tail[0])))
    return len(tail) / len(ascending) * float(np.exp(-(score - tail[0]) / scale))


def posterior_bound(p: float) -> float:
    """Largest posterior probability that the null hypothesis is false, for a p-value and even prior odds.

    1/(1 - e p log p) below 1/e; T. Sellke, M. J. Bayarri, J. O. Berger, The American Statistician 55 (2001).
    """
    if p <= 0:
        return 1.0
    return 1 / (1 - math.e * p * math.log(p)) if p < 1 / math.e else 0.5


def random_signs(bench: Workbench, draws: int, random: np.random.Generator) -> np.ndarray:
    """Random signs (draws x g) of the groups; the channels of one stretch of a recording have the same sign."""
    stretch = [(group.recording, group.stretch) for group in bench.groups]
    names = {name: index for index, name in enumerate(dict.fromkeys(stretch))}
    drawn = random.choice([-1.0, 1.0], size=(draws, len(names)))
    return drawn[:, [names[name] for name in stretch]]


def _linearised_costs(
    bench: Workbench,
    base: Fit,
    weights: np.ndarray,
    signs: np.ndarray,
    replaces: Sequence[str],
    columns: np.ndarray,
) -> np.ndarray:
    """Cost (draws) of the sign-flipped residuals after one Gauss-Newton step of the base's unknowns and the columns."""
    kept = kept_beside(base, replaces)
    J = np.hstack([base.jacobian[:, kept], columns])
    scale = np.sqrt(np.maximum(np.einsum("np,np,n->p", J, J, weights), 1e-300))
    J /= scale
    prior = prior_precision(base.unknowns)[kept]
    ridge = np.full(J.shape[1], ROUNDING)
    ridge[: len(prior)] += prior / scale[: len(prior)] ** 2
    gradients, products, normal = _group_sums(bench, base.residual, J, weights)
    steps = -np.linalg.solve(normal + np.diag(ridge), (signs @ gradients[0]).T).T
    # Sum of squares of each group: |r|^2 + 2 sign m.J'r + m.J'J m.
    squares = np.maximum(bench.sizes(base.residual) ** 2 * products[1], 0.0)
    squares = squares + 2 * signs * (steps @ gradients[1].T)
    squares += np.einsum("di,gij,dj->dg", steps, products[0], steps, optimize=True)
    sizes = np.sqrt(np.maximum(squares, 0.0) / products[1])
    return loss.loss(sizes) @ bench.count


def _group_sums(
    bench: Workbench, residual: np.ndarray, J: np.ndarray, weights: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], np.ndarray]:
    """J'wr and J'r of each group (g x p); J'J of each (g x p x p) and its number of samples (g); J'wJ (p x p)."""
    p, count = J.shape[1], len(bench.groups)
    weighted, plain = np.zeros((count, p)), np.zeros((count, p))
    products, samples = np.zeros((count, p, p)), np.ones(count)
    for index, group in enumerate(bench.groups):
        rows = group.rows
        part, known = J[rows] * bench.weight[rows, None], bench.weight[rows]
        plain[index] = part.T @ residual[rows]
        weighted[index] = part.T @ (weights[rows] * residual[rows])
        products[index] = part.T @ part
        samples[index] = max(known.sum(), 1.0)
    return (weighted, plain), (products, samples), J.T @ (weights[:, None] * J)
