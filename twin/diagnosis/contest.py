"""The best candidates of a round, fitted to the end and weighed against one another."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from twin.diagnosis import candidates, rules
from twin.diagnosis.candidates import Candidate
from twin.estimation import chain_limit
from twin.estimation.calibrate import seen_by
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.static_friction import with_static_levels
from twin.estimation.workbench import FreeData, Workbench
from twin.progress import Progress, silent
from twin.residuals.data import DrivenData
from twin.rigs.model import Model

CONTENDERS = 3  # candidates that are fitted to the end
_CLOSE = 0.3  # share of the best score that they need
_CLEARLY = 0.1  # by which the log of the errors of free runs has to differ
_ABOUT = 0.02  # share of the best score within which a simpler candidate is preferred
_SAME = 2e-3  # relative change of a clamped frequency that changes nothing: part of its resonance's width
FULL_ITERATIONS = 12  # iterations of a fit that is to arrive


def fit_to_convergence(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], progress: Progress = silent
) -> list[Candidate]:
    """The candidates, those that may be best fitted to the end."""
    best = ranked[0].score
    contenders = [c for c in ranked[:CONTENDERS] if c.score > _CLOSE * best]
    progress(f"weighing {', '.join(c.effects[-1] for c in contenders)}")
    rest = [c for c in ranked if c not in contenders]
    refined = [fit_fully(bench, base, c, c.fit.values) for c in contenders]
    left = min(bench.misfit(c.fit.residual) for c in refined)
    if left > rules.LEAST_SHARE * bench.misfit(base.residual):
        # A group that fits badly weighs little, so that a fit can settle with it: the other way is gone to the end too.
        goals = [c.fit.cost for c in refined]
        others = [
            fit_fully(bench, base, c, _anew(c.fit), goal) for c, goal in zip(contenders, goals, strict=True)
        ]
        refined = [min(pair, key=lambda c: c.fit.cost) for pair in zip(refined, others, strict=True)]
    return prefer_simpler(refined + rest)


def prefer_simpler(fitted_ones: Sequence[Candidate]) -> list[Candidate]:
    """The candidates by score, but of those that are about as good as the best the one of fewest parameters first.

    What a model gets wrong itself grows with what there is to explain, and every parameter more can follow it.
    """
    ranked = sorted(fitted_ones, key=lambda c: -c.score)
    best, near = ranked[0], _close(ranked[0].score)
    more = [max(1, len(best.fit.unknowns) - len(c.fit.unknowns)) for c in ranked]
    alike = [c for c, count in zip(ranked, more, strict=True) if c.score > best.score - count * near]
    simplest = min(alike, key=lambda c: len(c.fit.unknowns))
    return [simplest, *(c for c in ranked if c is not simplest)]


def prefer_closer_free_runs(bench: Workbench, ranked: list[Candidate]) -> list[Candidate]:
    """The candidates; of those that explain about as much, one whose free runs stay much closer first.

    Sticks and slips make a free run a poor judge of small differences; a clear one counts half of what decides. The
    static friction, on which free runs hang and which the search knows badly, is read where rests end first.
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
    """The candidate fitted with everything free, from these values (p); given up where it stays dearer than `goal`."""
    before = candidate.fit
    result = minimise(
        bench, before.model, before.starts, before.unknowns, first, None, FULL_ITERATIONS, goal=goal
    )
    return Candidate(candidate.effects, result, candidates.score_gain(bench, base, result))


def better_calibration(bench: Workbench, base: Fit, best: Candidate) -> Fit | None:
    """The base fitted from where a candidate came to, if that takes away enough of its gain to matter; else None.

    A calibration may have stopped short, of a recording that began in motion, say. Whatever is added to it goes on
    from there, and gains what calibration alone would have.
    """
    first = candidates.first_values(base.unknowns, base.model, base, best.fit)
    goal = base.cost - rules.decisive_difference(best.score)
    again = minimise(bench, base.model, base.starts, base.unknowns, first, None, FULL_ITERATIONS, goal=goal)
    return again if again.cost < goal else None


def _anew(before: Fit) -> np.ndarray:
    """The values (p) of a fit, declared parameters as declared: without the effect they had to stand in for it."""
    return np.array(
        [u.start if u.owner == "rig" else v for u, v in zip(before.unknowns, before.values, strict=True)]
    )


def confirm_in_fine_limit(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], by_chance: float
) -> tuple[list[Candidate], Candidate | None, Workbench]:
    """The candidates, and the one to adopt, if any, with the chain's own error taken out where it stands.

    What a coarse chain makes of an effect may be what is gained: near a resonance it answers to the least motion
    wrongly. A gain that is gone with the chain's error was none.

    Returns:
      The candidates, the one to adopt, and the data without the chain's error there.
    """
    ranked = list(ranked)
    checked: dict[Candidate, Workbench] = {}
    while (choice := rules.worth_adopting(bench, base, ranked, by_chance)) is not None:
        if choice in checked:
            return ranked, choice, checked[choice]
        own = copy(bench)
        fine = refit_in_fine_limit(own, choice.fit)
        found = replace(choice, fit=fine, score=candidates.score_gain(own, base, fine))
        checked[found] = own
        ranked[0] = found
        if found.score < choice.score - _close(choice.score):
            ranked = prefer_simpler(ranked)
    return ranked, None, bench


def refit_with_own_noise(bench: Workbench, base: Fit, found: Fit) -> tuple[Workbench, Fit]:
    """The data as an adopted model sees them, and its fit to them: another link rings otherwise with noise."""
    if not _rings_otherwise(found.model, base.model):
        return bench, found
    bench = seen_by(bench, found.model)
    return bench, refit_in_fine_limit(bench, found)


def _rings_otherwise(model: Model, before: Model) -> bool:
    now, then = (m.chain.modes("clamped")[0][:2] for m in (model, before))
    acts, acted = (
        {**m.plant.link.mechanisms, **m.plant.motor._replace(lag=0.0)._asdict()} for m in (model, before)
    )
    return acts != acted or bool(np.any(np.abs(now / then - 1) > _SAME))


def refit_in_fine_limit(bench: Workbench, found: Fit) -> Fit:
    """The fit with the chain's own error taken out where it now stands: an effect may bend the link as never before."""
    chain_limit.move(bench, found.model, found.starts, chain_limit.QUICK)
    return minimise(bench, found.model, found.starts, found.unknowns, found.values, iterations=6)


def _close(score: float) -> float:
    """Difference in score that is none: what the model gets wrong itself grows with what there is to explain."""
    return max(5.0, _ABOUT * score)
