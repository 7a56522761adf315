"""The rules that decide a diagnosis, each with its statistic, limit, source and reference.

`SCREENING` decides whether a candidate is fitted, `ADOPTION` whether the best candidate of a round is added to the
model, `REVISION` whether an adopted effect stays beside later ones, `EXPLANATION` whether the residuals of a channel
are explained. `docs/diagnosis.md` has their tables, written by `twin.diagnosis.judgement.markdown`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from twin.diagnosis import permutation
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement, Rule, judge_all
from twin.estimation import cross_validation, loss
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import Workbench
from twin.residuals.numerics import ROUNDING
from twin.residuals.significance import CERTAIN, FOLLOWS, SIGNIFICANT

MODEL_ERROR_SCORE = 30.0
"""Minimum score. The discretisation error of the chain reached 23 on rigs without a missing effect."""
MODEL_ERROR_SHARE = 5e-3
"""Share of the scores of earlier effects that the error of the model may gain: it grows with what they explain.

Between three engines it is 0.31 % at most; the smallest effect that is missing beside others has 1.9 %
(benchmarks/results/rules.md, second effects)."""
MODEL_SHARE = 0.05
"""Share of a residual or a score that the error of the model may be: an effect has to explain more of the misfit, may
leave so much of a residual without it, and is as good as another whose score is nearer than that; residuals depend on a
variable that explains more of their variance."""
LEAST_ELSEWHERE = 10.0
"""Cross-validated gain without the recording that gains most: odds of 20 000 to 1."""
TIE, TIE_SHARE = 5.0, 0.02
"""Largest score difference of a tie: 5 (odds of 150 to 1), or a share of the score, because the error of the model
grows with the misfit: 2 % for a simpler candidate to be preferred, `MODEL_SHARE` for two to be named together."""
REPEATED = 2
"""Recordings in which a channel has to show such a residual: a single recording may be faulty."""
LEAST_EVIDENCE = 7.0
"""Log Bayes factor of a smooth function (1100 to 1). Seven functions are tested in every campaign, each with its
maximum-likelihood hyperparameters: two of some 600 rigs with nothing missing reached 5.1 and 5.5."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate at the decision of one round.

    Attributes:
      bench: the data; for a candidate to be adopted, corrected for the discretisation error at its fit.
      base: the fit without the candidate.
      candidate: what is judged.
      place: its rank in the round, 1 for the best.
      by_chance: quantile of the permutation test at the false-alarm rate.
      gained: sum of the scores of the effects adopted before.
      least_fitted: lowest score of the candidates of the round that were fitted.
    """

    bench: Workbench
    base: Fit
    candidate: Candidate
    place: int = 1
    by_chance: float = 0.0
    gained: float = 0.0
    least_fitted: float = -math.inf


def least_score(gained: float) -> float:
    """Score that the error of the model may reach, by the sum of the scores of the effects that it has."""
    return max(MODEL_ERROR_SCORE, MODEL_ERROR_SHARE * gained)


def gain_elsewhere(bench: Workbench, base: Fit, best: Candidate) -> float:
    """Cross-validated gain in log likelihood without the recording that gains most; infinite for a single recording.

    Leave-one-recording-out cross-validation (`twin.estimation.cross_validation`), with all parameters from the other
    recordings or with those of the effect alone, whichever gains more. While another effect is missing, a calibration
    without one recording, a decay for example, can be far off with and without this effect.
    """
    if len(bench.prepared) < 2:  # a single recording cannot be cross-validated
        return math.inf
    with_calibration = _gains(
        bench, cross_validation.residual(bench, base), cross_validation.residual(bench, best.fit)
    )
    by_itself = _gains(bench, base.residual, cross_validation.residual(bench, best.fit, best.name))
    return max(float(gains.sum() - gains.max()) for gains in (with_calibration, by_itself))


def _gains(bench: Workbench, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Gain in cost of each recording (r) from one residual (n) to another."""
    costs = [bench.count * loss.loss(bench.sizes(residual)) for residual in (before, after)]
    return bench.by_recording(costs[0] - costs[1])


_NULLS = "benchmarks/results/diagnosis.md, rigs with nothing missing"

SCREENING: tuple[Rule[Trial], ...] = (
    Rule(
        "large-score-test",
        "Is the score test larger than the score of the worst candidate that was fitted?",
        "penalised score test at neutral [nat]",
        lambda t: t.candidate.score,
        lambda t: t.least_fitted,
        "above the smallest score of the 3 to 6 that are fitted a round",
        "policy",
        "twin.diagnosis.candidates.explore",
        above=True,
    ),
)
"""Whether a candidate is fitted."""

ELSEWHERE: Rule[Trial] = Rule(
    "gains-elsewhere",
    "Does the effect improve the prediction of recordings that its fit did not use?",
    "leave-one-recording-out cross-validated gain in log likelihood without the best recording [nat]",
    lambda t: gain_elsewhere(t.bench, t.base, t.candidate),
    lambda t: LEAST_ELSEWHERE,
    f"{LEAST_ELSEWHERE:g}",
    "assumed",
    "odds of 20 000 to 1; twin.estimation.cross_validation",
)
"""Whether a candidate is a law of the rig, and not a fault of one recording."""

BEST: Rule[Trial] = Rule(
    "best-of-round",
    "Is it the best candidate of the round, the simpler one of equals?",
    "rank in the round",
    lambda t: t.place,
    lambda t: 1,
    "1",
    "policy",
    "one effect is adopted a round",
    at_least=False,
)
"""Which of the candidates is adopted."""

ADOPTION: tuple[Rule[Trial], ...] = (
    BEST,
    Rule(
        "exceeds-chance",
        "Is the score larger than by chance at the false-alarm rate?",
        "penalised log-likelihood ratio [nat]",
        lambda t: t.candidate.score,
        lambda t: t.by_chance,
        "the (1 - rate) quantile of a sign-flip permutation test",
        "derived",
        "twin.diagnosis.permutation",
    ),
    Rule(
        "exceeds-model-error",
        "Is what it explains larger than by the discretisation error of the model and of the effects adopted before?",
        "penalised log-likelihood ratio, at most the misfit that was left [nat]",
        lambda t: min(t.candidate.score, t.bench.misfit(t.base.residual)),
        lambda t: least_score(t.gained),
        f"the larger of {MODEL_ERROR_SCORE:g} and {100 * MODEL_ERROR_SHARE:g} % of the sum of earlier scores",
        "measured",
        f"{_NULLS}: at most 23; benchmarks/results/rules.md, second effects",
    ),
    Rule(
        "explains-a-share",
        "Does the effect explain a sufficient share of the misfit?",
        "score over misfit",
        lambda t: t.candidate.score / max(t.bench.misfit(t.base.residual), ROUNDING),
        lambda t: MODEL_SHARE,
        f"{MODEL_SHARE:g}",
        "measured",
        f"{_NULLS}; benchmarks/results/rules.md: a torque gain beside a stop",
    ),
    ELSEWHERE,
)
"""Whether a candidate is added to the model. The scores are those in the limit of a fine chain, see
`contest.confirm_in_fine_limit`."""


@dataclass(frozen=True)
class Standing:
    """An adopted effect beside those adopted later.

    Attributes:
      difference: score that the model loses without it, or gains with another candidate in its place.
      gained: sum of the scores of all adopted effects, or the score of its own round.
      size: distance of the effect from neutral, in standard errors; 0 at the end of its range.
    """

    difference: float = 0.0
    gained: float = 0.0
    size: float = math.inf


NEEDED: Rule[Standing] = Rule(
    "needed-beside-later",
    "Is the effect still needed beside the later ones?",
    "penalised log-likelihood ratio of the models with and without it, both fitted [nat]",
    lambda s: s.difference,
    lambda s: least_score(s.gained),
    f"the larger of {MODEL_ERROR_SCORE:g} and {100 * MODEL_ERROR_SHARE:g} % of the sum of all scores",
    "measured",
    _NULLS,
)
REPLACEABLE: Rule[Standing] = Rule(
    "best-beside-later",
    "Is the effect still the best candidate of its round beside the later ones?",
    "penalised log-likelihood ratio of the models with another close candidate and with it, both fitted [nat]",
    lambda s: s.difference,
    lambda s: decisive_difference(s.gained),
    f"the larger of {TIE:g} and {100 * MODEL_SHARE:g} % of the score in its round",
    "assumed",
    "odds of 150 to 1",
    at_least=False,
)
SIZE_DETERMINED: Rule[Standing] = Rule(
    "size-is-determined",
    "Is its size determined, and within its range?",
    "distance from neutral [standard errors], 0 at the end of its range",
    lambda s: s.size,
    lambda s: SIGNIFICANT,
    f"{SIGNIFICANT:g}",
    "assumed",
    "two-sided normal probability 0.3 %",
)


@dataclass(frozen=True)
class Declaration:
    """A declared parameter beside its value in a fit without its prior; also gain or delay of a channel.

    Attributes:
      deviations: distance of the two in standard deviations of their difference.
      rate: the false-alarm rate.
      tested: number of effects that replace a declared parameter, or are an error of a channel.
    """

    deviations: float
    rate: float
    tested: int


CONTRADICTED: Rule[Declaration] = Rule(
    "declaration-contradicted",
    "Do the recordings contradict a declaration that an effect replaces?",
    "distance of the fitted from the declared value [standard deviations of their difference]",
    lambda d: d.deviations,
    lambda d: float(norm.isf(0.5 * d.rate / max(d.tested, 1))),
    "two-sided normal quantile of the false-alarm rate over the number of such effects",
    "derived",
    "the declared uncertainty is the deviation of a normal distribution; Bonferroni",
)


def p_value_of(declaration: Declaration) -> float:
    """Probability of a declaration as far off or farther, of any of those that are tested."""
    return min(1.0, 2 * declaration.tested * float(norm.sf(declaration.deviations)))


REVISION = (NEEDED, REPLACEABLE, SIZE_DETERMINED, CONTRADICTED)
"""Whether an adopted effect stays, and whether one joins because a declaration is contradicted."""


@dataclass(frozen=True)
class Leftover:
    """Residuals of one channel under the final model.

    Attributes:
      sizes: (r) root-mean-square in each recording, less the part that a right effect may leave [noise levels].
      deviations: (r) standard deviation of this size for noise alone.
      recordings: number of all recordings.
      evidence: largest log Bayes factor of a smooth function; of the torque balance of the hub alone.
      by_chance: threshold of the evidence at the false-alarm rate, by the permutation test.
      gained: sum of the scores of the adopted effects.
    """

    sizes: Sequence[float]
    deviations: Sequence[float]
    recordings: int
    evidence: float = -math.inf
    by_chance: float = 0.0
    gained: float = 0.0


def excesses(leftover: Leftover, floor: float, deviations: float) -> np.ndarray:
    """Residual sizes (r) over the larger of a floor and 1 plus so many standard deviations."""
    limits = np.maximum(floor, 1 + deviations * np.asarray(leftover.deviations))
    return np.asarray(leftover.sizes) / limits


EXPLANATION: tuple[Rule[Leftover], ...] = (
    Rule(
        "worst-residual",
        "Is the largest residual of the channel consistent with noise?",
        "largest root-mean-square residual of a recording over its limit",
        lambda x: float(excesses(x, FOLLOWS, CERTAIN).max(initial=0.0)),
        lambda x: 1,
        f"1; the limit is {FOLLOWS:g} noise levels or 1 + {CERTAIN:g} standard deviations",
        "measured",
        _NULLS,
        at_least=False,
    ),
    Rule(
        "repeated-residual",
        "Do fewer than two recordings have a residual of the channel above noise?",
        "number of recordings above the limit",
        lambda x: int((excesses(x, ADEQUATE_RMS, SIGNIFICANT) > 1).sum()),
        lambda x: min(REPEATED, x.recordings) - 1,
        f"{REPEATED - 1}, with a single recording 0; the limit is {ADEQUATE_RMS:g} noise levels or "
        f"1 + {SIGNIFICANT:g} standard deviations",
        "policy",
        "a single recording may be faulty; a note names it",
        at_least=False,
    ),
    Rule(
        "no-smooth-function",
        "Is no smooth torque on the hub over one variable significant?",
        "log Bayes factor of a Gaussian process",
        lambda x: x.evidence,
        lambda x: max(LEAST_EVIDENCE, MODEL_ERROR_SHARE * x.gained, x.by_chance),
        f"the largest of {LEAST_EVIDENCE:g}, {100 * MODEL_ERROR_SHARE:g} % of the sum of all scores, and the "
        "(1 - rate) quantile of a sign-flip permutation test",
        "measured",
        f"{_NULLS}: at most 5.5 in some 600",
        at_least=False,
    ),
)
"""Whether a channel is explained: it is not if both residual rules fail, or the one on a smooth function does."""


_ALL: tuple[Rule[Any], ...] = (*SCREENING, *ADOPTION, *REVISION, *EXPLANATION)
RULES: dict[str, Rule[Any]] = {rule.name: rule for rule in _ALL}
"""Every rule by its name."""


def judge_candidate(trial: Trial) -> tuple[Judgement, ...]:
    """Judgement of a fitted candidate by the rules of adoption, of any other by the rule of screening."""
    return judge_all(ADOPTION if trial.candidate.is_fitted else SCREENING, trial)


def tie(score: float) -> float:
    """Score difference within which a candidate with fewer parameters is preferred."""
    return max(TIE, TIE_SHARE * score)


def decisive_difference(score: float) -> float:
    """Score difference from which the better of two candidates is decided on."""
    return max(TIE, MODEL_SHARE * score)


def alternatives(rounds: Sequence[Sequence[Candidate]]) -> list[tuple[str, ...]]:
    """Sets of effects of one round whose scores are within `decisive_difference` of the best."""
    sets = []
    for ranked in rounds:
        alike = [c.name for c in ranked if c.score > ranked[0].score - decisive_difference(ranked[0].score)]
        if len(alike) > 1:
            sets.append(tuple(alike))
    return sets


def closest_pair(rounds: Sequence[Sequence[Candidate]]) -> tuple[Candidate, Candidate] | None:
    """The best two candidates of the first round in which their scores are within `decisive_difference`."""
    for ranked in rounds:
        if len(ranked) > 1 and ranked[1].score > ranked[0].score - decisive_difference(ranked[0].score):
            return ranked[0], ranked[1]
    return None


def probabilities(ranked: Sequence[Candidate], draws: np.ndarray) -> dict[str, float]:
    """Posterior probability of each candidate of one round to be the missing effect.

    Odds are exp(score difference / scale). The scale is 2 % of the best score, for the error of the model, and at least
    1. The sum of the probabilities is `permutation.posterior_bound` of the p-value of the best score.

    Args:
      ranked: the candidates, best first.
      draws: (d) scores of the permutation test, ascending.
    """
    scores = np.array([c.score for c in ranked])
    scale = max(1.0, TIE_SHARE * max(scores.max(), 0.0))
    weights = np.exp((scores - scores.max()) / scale)
    weights *= permutation.posterior_bound(permutation.p_value(draws, scores.max())) / weights.sum()
    return {c.name: float(w) for c, w in zip(ranked, weights, strict=True)}
