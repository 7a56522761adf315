"""When an effect is adopted, when nothing is missing, and when the library has no answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.diagnosis import chance
from twin.diagnosis.candidates import Candidate
from twin.estimation import cross_validation, loss
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench

LEAST_SHARE = (
    0.05  # of the misfit that an effect must explain: less is within what the model itself gets wrong
)
LEAST_SCORE = 30.0
"""Gain in log likelihood, after the price of its parameters, that chance may not need but the chain's own error does:
on recordings of a rig without a missing effect it gives up to 23."""
LEAST_ELSEWHERE = 10.0
"""Gain in log likelihood without the recording that gains most: odds of 20 000 that it is not that one alone."""
ALIKE = 0.8  # share of the best gain from which another effect counts as an equal explanation


def worth_adopting(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float = 0.0
) -> Candidate | None:
    """The best candidate, if it explains a real part of the misfit, and in more than one recording.

    `by_chance` is the score that chance alone gives too often; see `twin.diagnosis.chance`.
    A lone recording may be odd, and the chain is not the rig: an effect has to explain a fair share of what is left,
    and the recordings, each predicted by the others, have to gain by it even without the one that gains most.
    """
    if not ranked:
        return None
    best = ranked[0]
    left = bench.misfit(base.residual)
    if best.score < max(LEAST_SCORE, by_chance) or best.score < LEAST_SHARE * left:
        return None
    if len(bench.prepared) > 1 and gain_without_best_recording(bench, base, best) < LEAST_ELSEWHERE:
        return None
    return best


def gain_without_best_recording(bench: Workbench, base: Fit, best: Candidate) -> float:
    """Gain in cost without the recording that gains most, each predicted by the others; see
    `twin.estimation.cross_validation`.

    Predicted is what the effect adds, or the calibration with it, whichever tells more: where another effect is
    missing still, the calibration without a decay, say, goes far astray with any effect and without.
    """
    with_calibration = _gains(
        bench, cross_validation.residual(bench, base), cross_validation.residual(bench, best.fit)
    )
    by_itself = _gains(bench, base.residual, cross_validation.residual(bench, best.fit, best.effects[-1]))
    return max(float(gains.sum() - gains.max()) for gains in (with_calibration, by_itself))


def _gains(bench: Workbench, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Gain in cost of each recording (r) from one residual to another."""
    costs = [bench.count * loss.loss(bench.sizes(residual)) for residual in (before, after)]
    gains = np.zeros(len(bench.prepared))
    for group, gain in zip(bench.groups, costs[0] - costs[1], strict=True):
        gains[group.recording] += gain
    return gains


def alternatives(rounds: Sequence[Sequence[Candidate]]) -> list[tuple[str, ...]]:
    """Sets of effects of the adopting rounds that explain the recordings about as well as the adopted one."""
    sets = []
    for ranked in rounds:
        best = ranked[0]
        alike = [c.effects[-1] for c in ranked if c.score > best.score - decisive_difference(best.score)]
        if len(alike) > 1:
            sets.append(tuple(alike))
    return sets


def closest_pair(rounds: Sequence[Sequence[Candidate]]) -> tuple[Candidate, Candidate] | None:
    """The adopted and the next best candidate of the first round in which they explain about as much."""
    for ranked in rounds:
        if len(ranked) > 1 and ranked[1].score > ranked[0].score - decisive_difference(ranked[0].score):
            return ranked[0], ranked[1]
    return None


def decisive_difference(score: float) -> float:
    """Difference in score that decides: what the model gets wrong itself grows with what there is to explain."""
    return max(5.0, (1 - ALIKE) * 0.25 * score)


def probabilities(ranked: Sequence[Candidate], draws: np.ndarray) -> dict[str, float]:
    """Of each candidate of one round, that it is the missing one: odds tempered by the model's own error.

    That it is chance and nothing is missing takes its part; `draws` are scores that chance gives.
    """
    scores = np.array([c.score for c in ranked])
    scale = max(1.0, 0.02 * max(scores.max(), 0.0))
    weights = np.exp((scores - scores.max()) / scale)
    weights *= chance.posterior_bound(chance.p_value(draws, scores.max())) / weights.sum()
    return {c.effects[-1]: float(w) for c, w in zip(ranked, weights, strict=True)}
