"""The best candidates of a round, fitted to convergence and weighed against one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.diagnosis import candidates, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement, passes
from twin.diagnosis.rules import Trial
from twin.estimation import chain_limit
from twin.estimation.calibrate import with_noise_of
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.static_friction import with_static_levels
from twin.estimation.workbench import FreeData, Workbench
from twin.progress import Progress, silent
from twin.residuals.data import DrivenData
from twin.rigs.model import Model

CONTENDERS = 3
"""Candidates that are fitted to convergence."""
_LEAST_SHARE = 0.3  # share of the best score that a candidate needs for that
_CLEARLY = 0.1  # difference in the mean log size of free-run errors that decides
_SAME_FREQUENCY = 2e-3  # relative change of a clamped frequency within the width of its resonance
FULL_ITERATIONS = 12
"""Iterations of a fit to convergence."""


def fit_to_convergence(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], progress: Progress = silent
) -> list[Candidate]:
    """Fits the candidates that may be best to convergence; returns all candidates, ranked again.

    Where the best of them leave much, each is fitted once more from the declared parameters: a group of residuals that
    fits badly has little weight, and a fit can converge to a local minimum with it.
    """
    best = ranked[0].score
    contenders = [c for c in ranked[:CONTENDERS] if c.score > _LEAST_SHARE * best]
    progress(f"weighing {', '.join(c.name for c in contenders)}")
    rest = [c for c in ranked if c not in contenders]
    refined = [fit_fully(bench, base, c, c.fit.values) for c in contenders]
    left = min(bench.misfit(c.fit.residual) for c in refined)
    if left > rules.LEAST_SHARE * bench.misfit(base.residual):
        goals = [c.fit.cost for c in refined]
        others = [
            fit_fully(bench, base, c, _from_declared(c.fit), goal)
            for c, goal in zip(contenders, goals, strict=True)
        ]
        refined = [min(pair, key=lambda c: c.fit.cost) for pair in zip(refined, others, strict=True)]
    return prefer_simpler(refined + rest)


def prefer_simpler(fitted: Sequence[Candidate]) -> list[Candidate]:
    """The candidates by score; of those tied with the best, the one with the fewest parameters first.

    Each parameter more has to gain `rules.tie`: the model's error grows with what there is to explain, and every
    parameter can follow it.
    """
    ranked = sorted(fitted, key=lambda c: -c.score)
    best, near = ranked[0], rules.tie(ranked[0].score)
    more = [max(1, len(best.fit.unknowns) - len(c.fit.unknowns)) for c in ranked]
    alike = [c for c, count in zip(ranked, more, strict=True) if c.score > best.score - count * near]
    simplest = min(alike, key=lambda c: len(c.fit.unknowns))
    return [simplest, *(c for c in ranked if c is not simplest)]


def prefer_closer_free_runs(bench: Workbench, ranked: list[Candidate]) -> list[Candidate]:
    """The candidates; of those whose scores do not decide, one whose free runs are clearly closer first.

    A free run is simulated from its first samples and its command alone. Sticks and slips make it a poor judge of
    small differences, so that a clear one counts half of what decides. Static friction, which free runs depend on and
    which the search determines badly, is read from the ends of rests first.
    """
    alike = [
        c
        for c in ranked[:CONTENDERS]
        if c.score > ranked[0].score - rules.decisive_difference(ranked[0].score)
    ]
    if len(alike) < 2:
        return ranked
    assert isinstance(bench.data, DrivenData)
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
    bench: Workbench, base: Fit, candidate: Candidate, first: np.ndarray, goal: float = np.inf
) -> Candidate:
    """The candidate fitted with all unknowns free.

    Args:
      bench: the data.
      base: the fit that it was added to.
      candidate: what is fitted.
      first: (p) values to start from.
      goal: cost that it has to come below; the fit is given up where it would not.
    """
    before = candidate.fit
    result = minimise(
        bench, before.model, before.starts, before.unknowns, first, None, FULL_ITERATIONS, goal=goal
    )
    return Candidate(candidate.effects, result, candidates.score_gain(bench, base, result))


def better_calibration(bench: Workbench, base: Fit, best: Candidate) -> Fit | None:
    """The base fitted again from the values of a candidate, if that takes away enough of its gain to decide.

    A calibration may have stopped short of its minimum, with a recording that began in motion for example. Any
    candidate continues from there, and gains what calibration alone would have gained.
    """
    first = candidates.first_values(base.unknowns, base.model, base, best.fit)
    goal = base.cost - rules.decisive_difference(best.score)
    again = minimise(bench, base.model, base.starts, base.unknowns, first, None, FULL_ITERATIONS, goal=goal)
    return again if again.cost < goal else None


def _from_declared(before: Fit) -> np.ndarray:
    """The values (p) of a fit, with declared parameters as declared: without the effect they stood in for it."""
    return np.array(
        [u.start if u.kind == "rig" else v for u, v in zip(before.unknowns, before.values, strict=True)]
    )


def confirm_in_fine_limit(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float, gained: float
) -> tuple[list[Candidate], Candidate | None, Workbench]:
    """Judges the best candidate with the chain's own error taken out where it stands.

    A coarse chain answers to small motions wrongly near a resonance; a gain that vanishes with the chain's error was
    none. The candidate that is best then is judged in its turn.

    Args:
      bench: the data.
      base: the fit that the candidates were added to.
      ranked: the candidates, best first.
      by_chance: quantile of the permutation test.
      gained: sum of the scores of the effects adopted before.

    Returns:
      The candidates, the one to adopt or None, and the data without the chain's error there.
    """
    ranked = list(ranked)
    checked: dict[Candidate, Workbench] = {}
    while ranked and passes(rules.judge_candidate(Trial(bench, base, ranked[0], 1, by_chance, gained))):
        choice = ranked[0]
        if choice in checked:
            return ranked, choice, checked[choice]
        own, fine = refit_in_fine_limit(bench, choice.fit)
        found = replace(choice, fit=fine, score=candidates.score_gain(own, base, fine))
        checked[found] = own
        ranked[0] = found
        if found.score < choice.score - rules.tie(choice.score):
            ranked = prefer_simpler(ranked)
    return ranked, None, bench


def judge_round(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float, gained: float
) -> dict[str, tuple[Judgement, ...]]:
    """Candidate -> what the rules say of it; arguments as `confirm_in_fine_limit`."""
    least = min((c.score for c in ranked if c.is_fitted), default=0.0)
    return {
        c.name: rules.judge_candidate(Trial(bench, base, c, place, by_chance, gained, least))
        for place, c in enumerate(ranked, start=1)
    }


def refit_with_own_noise(bench: Workbench, base: Fit, found: Fit) -> tuple[Workbench, Fit]:
    """The data whitened for an adopted model, and its fit to them.

    Noise of the hub's sensor makes the modelled link ring; another link rings at other frequencies.
    """
    if not _rings_otherwise(found.model, base.model):
        return bench, found
    return refit_in_fine_limit(with_noise_of(bench, found.model), found)


def _rings_otherwise(model: Model, before: Model) -> bool:
    now, then = (m.chain.modes("clamped")[0][:2] for m in (model, before))
    acts, acted = (
        {**m.plant.link.mechanisms, **m.plant.motor._replace(lag=0.0)._asdict()} for m in (model, before)
    )
    return acts != acted or bool(np.any(np.abs(now / then - 1) > _SAME_FREQUENCY))


def refit_in_fine_limit(bench: Workbench, found: Fit) -> tuple[Workbench, Fit]:
    """The data without the chain's own error where a fit stands, and the fit to them."""
    bench, _ = chain_limit.without_discretisation_error(
        bench, found.model, found.starts, chain_limit.STANDARD
    )
    return bench, minimise(bench, found.model, found.starts, found.unknowns, found.values, iterations=6)
