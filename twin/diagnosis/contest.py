"""The best candidates of a round, fitted to convergence and compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin import labels
from twin.diagnosis import candidates, fit_start, rules
from twin.diagnosis.candidates import CONTENDERS, Candidate
from twin.diagnosis.judgement import Judgement, judge_all
from twin.diagnosis.rules import Trial
from twin.estimation import chain_limit, refine
from twin.estimation.calibrate import with_noise_of
from twin.estimation.fit import Fit
from twin.estimation.minimise import FAR_ITERATIONS, minimise, with_own_jacobian
from twin.estimation.static_friction import with_static_levels
from twin.estimation.workbench import FreeData, Workbench
from twin.progress import Progress, silent
from twin.residuals.data import DrivenData
from twin.residuals.numerics import FIXED_POINT_STEPS
from twin.rigs.model import Model

_CLEARLY = 0.1  # difference in the mean log size of free-run errors that decides
_SAME_FREQUENCY = 2e-3  # relative change of a clamped frequency within the width of its resonance


def fit_to_convergence(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], progress: Progress = silent
) -> list[Candidate]:
    """Fits the candidates that may be best to convergence; returns all candidates, ranked again.

    A fit is given up where it would stay behind the best by more than `rules.decisive_difference`.
    """
    contenders = [c for c in ranked[:CONTENDERS] if c.score > 0]
    progress(f"comparing {', '.join(labels.words(c.name) for c in contenders)}")
    rest = [c for c in ranked if c not in contenders]
    refined = list[Candidate]()
    for c in contenders:
        known = c.fit.jacobian if len(c.fit.jacobian) else None
        refined.append(fit_fully(bench, base, c, _most_cost(refined), known))
    first, *others = prefer_simpler(refined + rest)
    # A simpler one behind the contenders, of an earlier round: see `Candidate.stored`.
    if not len(first.fit.jacobian):
        first = fit_fully(bench, base, first)
    return [first, *others]


def _most_cost(refined: Sequence[Candidate]) -> float:
    """Cost up to which a fit is not clearly behind the best of some candidates."""
    if not refined:
        return np.inf
    best = min(refined, key=lambda c: c.fit.cost)
    return best.fit.cost + rules.decisive_difference(best.score)


def prefer_simpler(fitted: Sequence[Candidate]) -> list[Candidate]:
    """The candidates by score; of those tied with the best, the one with the fewest parameters first.

    Each additional parameter has to gain `rules.tie`, because it can also fit the error of the model.
    """
    ranked = sorted(fitted, key=lambda c: -c.score)
    best, near = ranked[0], rules.tie(ranked[0].score)
    more = [max(1, len(best.fit.unknowns) - len(c.fit.unknowns)) for c in ranked]
    alike = [c for c, count in zip(ranked, more, strict=True) if c.score > best.score - count * near]
    simplest = min(alike, key=lambda c: len(c.fit.unknowns))
    return [simplest, *(c for c in ranked if c is not simplest)]


def prefer_closer_free_runs(bench: Workbench, ranked: list[Candidate]) -> list[Candidate]:
    """The candidates; of those tied with the best, the one with clearly smaller free-run errors first.

    A free run is simulated from its first samples and its command alone. It is sensitive to single sticks and slips, so
    only a clear difference counts, as half of `rules.decisive_difference`. Free runs depend strongly on the static
    friction, which the search determines poorly: it is estimated from the ends of rests first.
    """
    alike = [
        c
        for c in ranked[:CONTENDERS]
        if c.score > ranked[0].score - rules.decisive_difference(ranked[0].score)
    ]
    if len(alike) < 2 or not isinstance(bench.data, DrivenData):
        return ranked
    free = Workbench(FreeData(bench.prepared), bench.pool)
    read = [with_static_levels(bench.data, c.fit) for c in alike]
    cost = [free.cost(r) for r in free.residuals([(f.model, f.starts, None) for f in read])]
    closest = alike[int(np.argmin(cost))]
    if cost[0] - min(cost) <= _CLEARLY * free.count.sum():
        return ranked
    most = closest.score - 0.5 * rules.decisive_difference(ranked[0].score)
    rest = [replace(c, score=min(c.score, most)) for c in ranked if c is not closest]
    return [closest, *sorted(rest, key=lambda c: -c.score)]


def fit_fully(
    bench: Workbench,
    base: Fit,
    candidate: Candidate,
    goal: float = np.inf,
    jacobian: np.ndarray | None = None,
) -> Candidate:
    """The candidate fitted with all unknowns free.

    Args:
      bench: the data.
      base: the fit that it was added to.
      candidate: what is fitted, from its values.
      goal: cost that it has to come below; the fit is given up where it would not.
      jacobian: (n x p) of these data there, if it is known.
    """
    before = candidate.fit
    # What is less than the error of the model decides nothing.
    tolerance = rules.MODEL_ERROR_SHARE * max(candidate.score, rules.MODEL_ERROR_SCORE)
    at = before.model, before.starts, before.unknowns, before.values
    result = minimise(
        bench, *at, iterations=FAR_ITERATIONS, tolerance=tolerance, goal=goal, first_jacobian=jacobian
    )
    return Candidate(candidate.effects, result, candidates.score_gain(bench, base, result))


def better_calibration(bench: Workbench, base: Fit, best: Candidate) -> Fit | None:
    """The base refitted from the values of a candidate, if this gains at least `rules.decisive_difference`; else None.

    If the calibration stopped before its minimum, for example with a recording that began in motion, any candidate
    continues the descent and its score contains the gain of the calibration.
    """
    moved = {name: best.fit.model.effects[name] for name in base.model.effects}
    model = base.model.replace(effects=moved)
    first = fit_start.initial_values_near(bench, base.unknowns, model, base, best.fit)
    # An effect that replaces a declared parameter has found a value of it, maybe beyond its uncertainty.
    instead = best.fit.model.effects.get(best.name, {})
    for k, u in enumerate(base.unknowns):
        if u.kind == "rig":
            first[k] = instead.get(u.name, first[k])
    goal = base.cost - rules.decisive_difference(best.score)
    at = bench, base.model, base.starts, base.unknowns, first
    again = minimise(*at, iterations=FAR_ITERATIONS, goal=goal, first_jacobian=base.jacobian)
    return again if again.cost < goal else None


def confirm_in_fine_limit(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float, gained: float
) -> tuple[list[Candidate], Candidate | None, Workbench]:
    """Judges the best candidate with its residuals corrected for the discretisation error of the chain.

    The response of a coarse chain near a resonance is inaccurate, and an effect may gain by fitting this error. If the
    corrected score is clearly smaller, the candidate that is then the best is corrected and judged in turn. One that
    does not predict other recordings than it is fitted to is no law of the rig: it makes room for the next.

    Args:
      bench: the data.
      base: the fit that the candidates were added to.
      ranked: the candidates, best first.
      by_chance: quantile of the permutation test.
      gained: sum of the scores of the effects adopted before.

    Returns:
      The candidates, the one to adopt or None, and the data corrected at its fit.
    """
    ranked, local = list(ranked), list[Candidate]()
    checked: dict[Candidate, Workbench] = {}
    while ranked:
        choice = ranked[0]
        judged = judge_all(rules.ADOPTION, Trial(bench, base, choice, 1, by_chance, gained))
        failed = {judgement.rule for judgement in judged if not judgement.passed}
        if failed == {rules.ELSEWHERE.name}:
            local.append(ranked.pop(0))
            continue
        if failed:
            break
        if choice in checked:
            return [choice, *local, *ranked[1:]], choice, checked[choice]
        own, fine = refit_in_fine_limit(bench, choice.fit, choice.fit.jacobian)
        corrected = replace(choice, fit=fine, score=candidates.score_gain(own, base, fine))
        checked[corrected] = own
        ranked[0] = corrected
        if corrected.score < choice.score - rules.tie(choice.score):
            ranked = prefer_simpler(ranked)
    return [*local, *ranked], None, bench


def judge_round(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float, gained: float
) -> dict[str, tuple[Judgement, ...]]:
    """Candidate -> its judgement by each rule; arguments as `confirm_in_fine_limit`."""
    least = min((c.score for c in ranked if c.is_fitted), default=0.0)
    return {
        c.name: rules.judge_candidate(Trial(bench, base, c, place, by_chance, gained, least))
        for place, c in enumerate(ranked, start=1)
    }


def refit_with_own_noise(bench: Workbench, base: Fit, fit: Fit) -> tuple[Workbench, Fit]:
    """The data whitened for an adopted model, and its fit to them; unchanged if the model of the link is the same.

    Noise of the hub angle excites the modelled link at its resonances, so the noise of the residuals depends on them.
    """
    if not isinstance(bench.data, DrivenData):
        return bench, fit
    if _has_other_resonances(fit.model, base.model):
        bench = chain_limit.with_limit(
            with_noise_of(bench, fit.model), fit.model, fit.starts, chain_limit.STANDARD
        )
        fit = minimise(bench, fit.model, fit.starts, fit.unknowns, fit.values)
    return bench, with_own_jacobian(bench, fit)


def _has_other_resonances(model: Model, before: Model) -> bool:
    now, then = (m.chain.modes("clamped")[0][:2] for m in (model, before))
    mechanisms, earlier = (
        {**m.plant.link.mechanisms, **m.plant.motor._replace(lag=0.0)._asdict()} for m in (model, before)
    )
    return mechanisms != earlier or bool(np.any(np.abs(now / then - 1) > _SAME_FREQUENCY))


def refit_in_fine_limit(
    bench: Workbench, fit: Fit, jacobian: np.ndarray | None = None
) -> tuple[Workbench, Fit]:
    """The data corrected for the discretisation error of the chain at a fit, and the fit to them.

    Args:
      bench: the data.
      fit: where the error is evaluated, and the fit to these data begins.
      jacobian: (n x p) of these data there, if it is known.
    """
    bench = _corrected_at(bench, fit)
    return bench, minimise(bench, fit.model, fit.starts, fit.unknowns, fit.values, first_jacobian=jacobian)


def refit_in_own_limit(bench: Workbench, fit: Fit) -> tuple[Workbench, Fit]:
    """The data corrected for the discretisation error at their own fit, which is a fixed point, and that fit.

    The error is taken as constant beside the fit. That of a softening link changes with its parameters: fitted to an
    error that was evaluated at the fit before, they keep half of their distance, see benchmarks/results/diagnosis.md.
    """
    for _ in range(FIXED_POINT_STEPS):
        bench = _corrected_at(bench, fit)
        fit = refine.evaluated_on(bench, fit)
        before, promised = fit.cost, refine.predicted_gain(bench, fit)
        if promised >= refine.MIN_GAIN:
            at = fit.model, fit.starts, fit.unknowns, fit.values
            fit = minimise(bench, *at, iterations=1, first_jacobian=fit.jacobian)
        if before - fit.cost < refine.MIN_GAIN:
            break
    return bench, fit


def _corrected_at(bench: Workbench, fit: Fit) -> Workbench:
    """The data corrected for the discretisation error of the chain at a fit."""
    at = fit.model, fit.starts, chain_limit.STANDARD
    return chain_limit.without_discretisation_error(bench, *at)[0]
