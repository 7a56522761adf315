"""How large a score chance alone gives: the threshold of a search at a false-alarm rate that the user states.

Where nothing is missing, what the calibrated model leaves is noise and the chain's own error. Neither knows the sign
that an effect would give it: turned over at random, stretch by stretch and all channels of a recording together, it
is as likely as it was (a randomisation test). In each such draw every candidate is scored by its slopes as in the
search, against declared parameters that may give way too; the largest score of all candidates is what chance gives.
The (1 - rate) quantile of it is the threshold. It depends on this campaign alone: on its recordings, its channels,
the library, and the size and correlation of what is left.

Orders of waves are chosen from a spectrum, which the draws do not repeat: the largest of n equally likely peaks of
two coefficients exceeds one of them by log n on average, which is added; where noise is not white, by as much more as
the spectrum there is usually higher than that of white noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.estimation import loss
from twin.estimation.fit import Fit
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench

DRAWS = 400


@dataclass(frozen=True, eq=False)
class Slopes:
    """What a candidate promises to first order.

    Attributes:
      columns: (n x k) change of the residual with each of its parameters.
      replaces: declared parameters that it takes the place of.
      price: of its parameters.
      rivals: number of equally likely places from which these columns were chosen.
      level: gain that is usual about the place, in that of white noise.
      coefficients: (k x c) of `Effect.linear`, of each column; empty where the effect has none.
    """

    columns: np.ndarray
    replaces: tuple[str, ...]
    price: float
    rivals: int = 1
    level: float = 1.0
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def permutation_scores(
    bench: Workbench, base: Fit, slopes: Mapping[str, Slopes], draws: int = DRAWS, seed: int = 0
) -> np.ndarray:
    """Largest score over all candidates in each draw (draws), ascending.

    Args:
      bench: the data.
      base: the fit beyond which effects were sought.
      slopes: candidate -> its slopes at this fit.
      draws: number of random sign patterns.
      seed: of the signs: the same campaign gets the same threshold.
    """
    signs = random_signs(bench, draws, np.random.default_rng(seed))
    weights = row_weights(bench, base.residual)
    largest = np.zeros(draws)
    alone = {}
    for candidate in slopes.values():
        if not candidate.columns.shape[1]:
            continue
        if candidate.replaces not in alone:
            alone[candidate.replaces] = _losses(bench, base, weights, signs, candidate.replaces, None)
        with_it = _losses(bench, base, weights, signs, candidate.replaces, candidate.columns)
        gain = (
            alone[candidate.replaces] - with_it - candidate.price + candidate.level * np.log(candidate.rivals)
        )
        largest = np.maximum(largest, gain)
    return np.sort(largest)


def threshold(ascending: Sequence[float] | np.ndarray, rate: float) -> float:
    """Score that chance exceeds at this rate: the (1 - rate) quantile of the draws, rounded up."""
    values = np.asarray(ascending)
    return float(values[min(len(values) - 1, int(np.ceil((1 - rate) * len(values))))])


def p_value(ascending: np.ndarray, score: float) -> float:
    """Probability that chance gives a score as large: beyond the upper tenth of the draws it falls exponentially.

    By as much as the draws there do, but no faster than the log likelihood ratio of one more parameter.
    """
    begin = len(ascending) - max(1, len(ascending) // 10)
    tail = ascending[begin:]
    if score <= tail[0]:
        return float(np.mean(ascending >= score))
    scale = max(1.0, float(np.mean(tail - tail[0])))
    return len(tail) / len(ascending) * float(np.exp(-(score - tail[0]) / scale))


def posterior_bound(p: float) -> float:
    """Largest probability that what chance exceeds with probability p is not chance, at even odds before.

    1/(1 - e p log p) below 1/e; T. Sellke, M. J. Bayarri, J. O. Berger, The American Statistician 55 (2001).
    """
    if p <= 0:
        return 1.0
    return 1 / (1 - np.e * p * np.log(p)) if p < 1 / np.e else 0.5


def random_signs(bench: Workbench, draws: int, random: np.random.Generator) -> np.ndarray:
    """Random signs (draws x g) of the groups; stretches of one recording at one time share theirs."""
    place: dict[tuple[int, str], int] = {}
    stretch = []
    for group in bench.groups:
        key = (group.recording, group.channel)
        place[key] = place.get(key, -1) + 1
        stretch.append((group.recording, place[key]))
    names = {name: index for index, name in enumerate(dict.fromkeys(stretch))}
    drawn = random.choice([-1.0, 1.0], size=(draws, len(names)))
    return drawn[:, [names[name] for name in stretch]]


def _losses(
    bench: Workbench,
    base: Fit,
    weights: np.ndarray,
    signs: np.ndarray,
    replaces: Sequence[str],
    columns: np.ndarray | None,
) -> np.ndarray:
    """Cost (draws) after the best linear move of the base's unknowns and the columns, residuals signed."""
    kept = np.array([u.kind != "rig" or u.name not in replaces for u in base.unknowns], dtype=bool)
    J = base.jacobian[:, kept] if columns is None else np.hstack([base.jacobian[:, kept], columns])
    scale = np.sqrt(np.maximum(J.T**2 @ weights, 1e-300))
    J = J / scale
    prior = prior_precision(base.unknowns)[kept]
    ridge = np.full(J.shape[1], 1e-9)
    ridge[: len(prior)] += prior / scale[: len(prior)] ** 2
    slopes, products, normal = _by_group(bench, base.residual, J, weights)
    moves = -np.linalg.solve(normal + np.diag(ridge), (signs @ slopes[0]).T).T
    # Squares of each group: |r|^2 + 2 sign m.J'r + m.J'J m.
    squares = np.maximum(bench.sizes(base.residual) ** 2 * products[1], 0.0)
    squares = squares + 2 * signs * (moves @ slopes[1].T)
    squares += np.einsum("di,gij,dj->dg", moves, products[0], moves, optimize=True)
    sizes = np.sqrt(np.maximum(squares, 0.0) / products[1])
    return loss.loss(sizes) @ bench.count


def _by_group(
    bench: Workbench, residual: np.ndarray, J: np.ndarray, weights: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Sums over each group: J'wr and J'r (g x p); J'J (g x p x p) and the number of samples (g); and J'wJ (p x p)."""
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
