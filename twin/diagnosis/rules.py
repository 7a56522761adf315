"""The rules that decide a diagnosis, each with its statistic, limit, source and reference.

`ADOPTION` decides whether the best candidate of a round is added to the model, `REVISION` whether an adopted effect
stays beside later ones, `EXPLANATION` whether what is left is explained. `docs/diagnosis.md` has
their tables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.diagnosis import chance
from twin.diagnosis.candidates import Candidate, is_resolved
from twin.diagnosis.judgement import Judgement, Rule, judge_all
from twin.estimation import cross_validation, loss
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import Workbench

MODEL_ERROR_SCORE = 30.0
"""Score that the chain's discretisation error does not reach: up to 23 on rigs without a missing effect."""
MODEL_ERROR_SHARE = 2e-3
"""Share of what earlier effects gained that their own error may gain once more: it grows with what they explain."""
LEAST_SHARE = 0.05
"""Share of the misfit that an effect has to explain: less is within what the model itself gets wrong."""
LEAST_ELSEWHERE = 10.0
"""Cross-validated gain without the recording that gains most: odds of 20 000 to 1."""
TOLD = 3.0
"""Standard errors from neutral from which the size of an effect is told."""
TIE, TIE_SHARE, DECISIVE_SHARE = 5.0, 0.02, 0.05
"""Score differences that decide nothing: 5 (odds of 150 to 1), or a share of the score, as the model's error grows with
what there is to explain: 2 % for a simpler candidate to be preferred, 5 % for two candidates to be named together."""
WORST_RESIDUAL = 2.0
"""Noise levels beyond which the worst residual of a channel is not explained."""
LEFT_SHARE = 0.05
"""Share of a residual before any effect was adopted that a right effect may leave: its discretisation."""
SIZE_DEVIATIONS, WORST_DEVIATIONS = 3.0, 5.0
"""Standard deviations by which the size of so much noise may seem too large, of any residual and of the worst."""
REPEATED = 2
"""Recordings in which a channel must show such a residual: a lone recording may be odd."""
LEAST_EVIDENCE = 7.0
"""Log Bayes factor of a smooth function (1100 to 1). Seven functions are asked for in every campaign, each at its
likeliest size and length: two of some 600 nulls came to 5.1 and 5.5."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate at the decision of one round.

    Attributes:
      bench: the data, for the candidate to be adopted without the chain's own error where it stands.
      base: the fit beside which it was sought.
      candidate: what is judged.
      place: its place in the round's ranking, 1 for the best.
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


def gain_without_best_recording(bench: Workbench, base: Fit, best: Candidate) -> float:
    """Cross-validated gain in log likelihood without the recording that gains most.

    Each recording is predicted by the fit to the others (`twin.estimation.cross_validation`): with the whole
    calibration, or by the effect's parameters alone, whichever gains more. Where another effect is still missing, the
    calibration without one recording, a decay say, can be far off with any effect and without.
    """
    with_calibration = _gains(
        bench, cross_validation.residual(bench, base), cross_validation.residual(bench, best.fit)
    )
    by_itself = _gains(bench, base.residual, cross_validation.residual(bench, best.fit, best.name))
    return max(float(gains.sum() - gains.max()) for gains in (with_calibration, by_itself))


def _gains(bench: Workbench, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Gain in cost of each recording (r) from one residual (n) to another."""
    costs = [bench.count * loss.loss(bench.sizes(residual)) for residual in (before, after)]
    gains = np.zeros(len(bench.prepared))
    for group, gain in zip(bench.groups, costs[0] - costs[1], strict=True):
        gains[group.recording] += gain
    return gains


def _elsewhere(trial: Trial) -> float:
    # Of a single recording nothing can be told by the others.
    if len(trial.bench.prepared) < 2:
        return math.inf
    return gain_without_best_recording(trial.bench, trial.base, trial.candidate)


_NULLS = "benchmarks/results/diagnosis.md, rigs with nothing missing"

SCREENING: tuple[Rule[Trial], ...] = (
    Rule(
        "promises-enough",
        "Does the score test promise more than the candidates that were fitted?",
        "score test at neutral, less the price of the parameters",
        lambda t: t.candidate.score,
        lambda t: t.least_fitted,
        "more than the least of those fitted, 3 to 6 a round",
        "policy",
        "twin.diagnosis.candidates.explore",
        above=True,
    ),
)
"""Whether a candidate is fitted at all."""

ADOPTION: tuple[Rule[Trial], ...] = (
    Rule(
        "best-of-round",
        "Does no other candidate of the round explain the recordings better, or as well with fewer parameters?",
        "place in the ranking",
        lambda t: t.place,
        lambda t: 1,
        "1",
        "policy",
        "one effect is adopted a round",
        at_least=False,
    ),
    Rule(
        "is-resolved",
        "Is the effect larger than what data sheets of good sensors and cards leave open?",
        "1 if it is, 0 if not",
        lambda t: is_resolved(t.bench, t.base, t.candidate.fit),
        lambda t: 1,
        "1",
        "assumed",
        "a tenth of a sample period; 0.5 % of a gauge factor (data sheets of foil gauges)",
    ),
    Rule(
        "exceeds-chance",
        "Is the score larger than chance gives at the false-alarm rate?",
        "penalised log-likelihood ratio",
        lambda t: t.candidate.score,
        lambda t: t.by_chance,
        "the (1 - rate) quantile of a sign-flip permutation test",
        "derived",
        "twin.diagnosis.chance",
    ),
    Rule(
        "exceeds-model-error",
        "Is it larger than the discretisation error of the chain gives on a rig with nothing missing?",
        "penalised log-likelihood ratio",
        lambda t: t.candidate.score,
        lambda t: MODEL_ERROR_SCORE,
        f"{MODEL_ERROR_SCORE:g}",
        "measured",
        f"{_NULLS}: at most 23",
    ),
    Rule(
        "exceeds-earlier-error",
        "Is it larger than what the error of the effects adopted before gives?",
        "penalised log-likelihood ratio",
        lambda t: t.candidate.score,
        lambda t: MODEL_ERROR_SHARE * t.gained,
        f"{100 * MODEL_ERROR_SHARE:g} % of their scores",
        "measured",
        "benchmarks/results/diagnosis.md, rigs with large effects",
    ),
    Rule(
        "explains-a-share",
        "Does it explain a fair share of what is left?",
        "score over misfit",
        lambda t: t.candidate.score / max(t.bench.misfit(t.base.residual), 1e-12),
        lambda t: LEAST_SHARE,
        f"{LEAST_SHARE:g}",
        "measured",
        _NULLS,
    ),
    Rule(
        "gains-elsewhere",
        "Do the other recordings gain by it, each predicted by the others, even without the one that gains most?",
        "leave-one-recording-out gain in log likelihood",
        _elsewhere,
        lambda t: LEAST_ELSEWHERE,
        f"{LEAST_ELSEWHERE:g}",
        "assumed",
        "odds of 20 000 to 1; twin.estimation.cross_validation",
    ),
)
"""Whether a candidate is added to the model; of the one to be added all hold in the limit of a fine chain."""


@dataclass(frozen=True)
class Standing:
    """An adopted effect beside those adopted later.

    Attributes:
      difference: score that the model loses without it, or gains with another effect in its place.
      gained: sum of the scores of all adopted effects, or the score of its own round.
      size: distance of the effect from neutral, in standard errors.
      untold: number of adopted effects whose size is not told.
    """

    difference: float = 0.0
    gained: float = 0.0
    size: float = math.inf
    untold: int = 0


NEEDED: Rule[Standing] = Rule(
    "needed-beside-later",
    "Does the model without it explain the recordings worse, the later effects refitted?",
    "penalised log-likelihood ratio",
    lambda s: s.difference,
    lambda s: max(MODEL_ERROR_SCORE, MODEL_ERROR_SHARE * s.gained),
    f"{MODEL_ERROR_SCORE:g}, and {100 * MODEL_ERROR_SHARE:g} % of all scores",
    "measured",
    _NULLS,
)
REPLACEABLE: Rule[Standing] = Rule(
    "best-beside-later",
    "Does no close candidate of its round explain the recordings better beside the later effects?",
    "penalised log-likelihood ratio",
    lambda s: s.difference,
    lambda s: decisive_difference(s.gained),
    f"{TIE:g}, and {100 * DECISIVE_SHARE:g} % of the score of its round",
    "assumed",
    "odds of 150 to 1",
    at_least=False,
)
SIZE_TOLD: Rule[Standing] = Rule(
    "size-is-told",
    "Is its size told, where it stands beside another effect whose size is not?",
    "distance from neutral in standard errors",
    lambda s: s.size if s.untold > 1 else math.inf,
    lambda s: TOLD,
    f"{TOLD:g}",
    "assumed",
    "0.3 % of a normal distribution",
)
REVISION = (NEEDED, REPLACEABLE, SIZE_TOLD)
"""Whether an adopted effect stays."""


@dataclass(frozen=True)
class Leftover:
    """What the model that stands at the end leaves of one channel, as noise levels.

    Attributes:
      sizes: (r) root-mean-square of each recording, less what a right effect may leave of it.
      deviations: (r) standard deviation of the size of so much noise.
      recordings: number of recordings in all.
      evidence: log Bayes factor of the likeliest smooth function, of the hub's torque balance.
      by_chance: evidence that chance gives at the false-alarm rate.
      gained: sum of the scores of the adopted effects.
    """

    sizes: Sequence[float]
    deviations: Sequence[float]
    recordings: int
    evidence: float = -math.inf
    by_chance: float = 0.0
    gained: float = 0.0


def excesses(leftover: Leftover, floor: float, deviations: float) -> np.ndarray:
    """Residual sizes (r) over the larger of a floor and the size of noise, so many deviations up."""
    limits = np.maximum(floor, 1 + deviations * np.asarray(leftover.deviations))
    return np.asarray(leftover.sizes) / limits


EXPLANATION: tuple[Rule[Leftover], ...] = (
    Rule(
        "worst-residual",
        "Is the worst residual of the channel no larger than noise and a right model leave?",
        "largest residual over its limit",
        lambda x: float(excesses(x, WORST_RESIDUAL, WORST_DEVIATIONS).max(initial=0.0)),
        lambda x: 1,
        f"1, the limit being {WORST_RESIDUAL:g} noise levels, or 1 + {WORST_DEVIATIONS:g} standard deviations",
        "measured",
        _NULLS,
        at_least=False,
    ),
    Rule(
        "repeated-residual",
        "Do fewer than two recordings show a residual of that channel that is not sound?",
        "number of recordings",
        lambda x: int((excesses(x, ADEQUATE_RMS, SIZE_DEVIATIONS) > 1).sum()),
        lambda x: min(REPEATED, x.recordings) - 1,
        f"{REPEATED - 1}, sound being {ADEQUATE_RMS:g} noise levels or 1 + {SIZE_DEVIATIONS:g} standard deviations",
        "policy",
        "a lone recording may be odd; it is noted",
        at_least=False,
    ),
    Rule(
        "no-smooth-function",
        "Is what is left of the torque balance no smooth function of one variable?",
        "log Bayes factor",
        lambda x: x.evidence,
        lambda x: max(LEAST_EVIDENCE, MODEL_ERROR_SHARE * x.gained, x.by_chance),
        f"{LEAST_EVIDENCE:g}, {100 * MODEL_ERROR_SHARE:g} % of all scores, and what chance gives",
        "measured",
        f"{_NULLS}: 5.1 and 5.5 in two of 600",
        at_least=False,
    ),
)
"""Whether a channel is explained: it is not if both residual rules fail, or the one on a smooth function does."""


_ALL: tuple[Rule[Any], ...] = (*SCREENING, *ADOPTION, *REVISION, *EXPLANATION)
RULES: dict[str, Rule[Any]] = {rule.name: rule for rule in _ALL}
"""Every rule by its name."""


def judge_candidate(trial: Trial) -> tuple[Judgement, ...]:
    """What each rule of adoption says of a candidate; of one that was not fitted, why."""
    return judge_all(ADOPTION if trial.candidate.is_fitted else SCREENING, trial)


def tie(score: float) -> float:
    """Score difference within which a candidate with fewer parameters is preferred."""
    return max(TIE, TIE_SHARE * score)


def decisive_difference(score: float) -> float:
    """Score difference from which one of two candidates is decided for."""
    return max(TIE, DECISIVE_SHARE * score)


def alternatives(rounds: Sequence[Sequence[Candidate]]) -> list[tuple[str, ...]]:
    """Sets of effects of the adopting rounds whose scores differ by less than decides."""
    sets = []
    for ranked in rounds:
        alike = [c.name for c in ranked if c.score > ranked[0].score - decisive_difference(ranked[0].score)]
        if len(alike) > 1:
            sets.append(tuple(alike))
    return sets


def closest_pair(rounds: Sequence[Sequence[Candidate]]) -> tuple[Candidate, Candidate] | None:
    """The best two candidates of the first round in which their scores differ by less than decides."""
    for ranked in rounds:
        if len(ranked) > 1 and ranked[1].score > ranked[0].score - decisive_difference(ranked[0].score):
            return ranked[0], ranked[1]
    return None


def probabilities(ranked: Sequence[Candidate], draws: np.ndarray) -> dict[str, float]:
    """Probability of each candidate of one round to be the missing effect.

    Odds are exp(score difference), tempered by 2 % of the best score for the model's own error; what is left to chance
    is bounded by the p-value of the permutation test (`chance.posterior_bound`).

    Args:
      ranked: the candidates, best first.
      draws: (d) scores of the permutation test, ascending.
    """
    scores = np.array([c.score for c in ranked])
    scale = max(1.0, TIE_SHARE * max(scores.max(), 0.0))
    weights = np.exp((scores - scores.max()) / scale)
    weights *= chance.posterior_bound(chance.p_value(draws, scores.max())) / weights.sum()
    return {c.name: float(w) for c, w in zip(ranked, weights, strict=True)}
