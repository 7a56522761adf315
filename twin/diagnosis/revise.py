"""A backward look: an effect that was adopted first may be needless beside a later one, or stand for another.

An effect is picked while others are still missing, and may have gained by standing in for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace

from twin.diagnosis import candidates, contest, remainder, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.state import SearchState
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent

_QUICK = 5  # iterations of a fit that only tells whether it is worth going on
_FAR = 10.0  # times the score that an effect needs, from which a quick fit is enough to keep it


def revise(found: SearchState, progress: Progress = silent) -> SearchState:
    """The same, an effect dropped or another put in its place where those adopted later say so."""
    if len(found.adopted) < 2:
        return found
    progress("looking back at what was adopted")
    return _without_needless(_exchanged(found))


def _without_needless(found: SearchState) -> SearchState:
    names = found.names
    least = max(rules.LEAST_SCORE, remainder.OWN_ERROR * sum(c.score for c in found.adopted))
    without = {name: _without(found, name, least) for name in names[:-1]}
    scores = {name: candidates.score_gain(found.bench, other, found.best) for name, other in without.items()}
    needless = min(scores, key=lambda name: scores[name])
    if scores[needless] >= least:
        return found
    return rebuild(found, [n for n in names if n != needless], without[needless])


def _without(found: SearchState, name: str, least: float) -> Fit:
    """The fit of all effects but one; to the end where that one is in doubt."""
    effects = {n: p for n, p in found.best.model.effects.items() if n != name}
    quick = refit(found, effects, _QUICK, found.best)
    if candidates.score_gain(found.bench, quick, found.best) > _FAR * least:
        return quick
    return refit(found, effects, contest.FULL_ITERATIONS, quick)


def _exchanged(found: SearchState) -> SearchState:
    """The same with another pick of an earlier round where that was close and the other explains more by now."""
    effects = found.best.model.effects
    best, closest = None, found.best
    for pick, ranked in zip(found.names[:-1], found.rounds, strict=False):
        for other in _alike(ranked):
            name = other.effects[-1]
            if name in effects:
                continue
            tried = {name if n == pick else n: p for n, p in effects.items()}
            tried[name] = other.fit.model.effects[name]
            result = refit(found, tried, _QUICK, found.best)
            fewer = len(closest.unknowns) - len(result.unknowns)
            gained = closest.cost - result.cost + candidates.price(fewer, found.bench)
            if gained > rules.decisive_difference(ranked[0].score):
                best, closest = [n for n in tried if n not in found.known], result
    return found if best is None else rebuild(found, best, closest)


def _alike(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Candidates of a round that were fitted, and explained nearly as much as the one that was picked.

    What is missing beside them then may have helped either of them.
    """
    best = ranked[0].score
    least = min(rules.ALIKE * best, best - rules.decisive_difference(best))
    return [
        c for c in ranked[1 : contest.CONTENDERS] if c.score > least and c.effects[-1] in c.fit.model.effects
    ]


def refit(
    found: SearchState,
    effects: Mapping[str, Mapping[str, float]],
    iterations: int,
    near: Fit,
    bench: Workbench | None = None,
) -> Fit:
    """The fit with these effects, from the values of another one; a quick one has its slopes, too."""
    bench = bench or found.bench
    model = near.model.replace(effects={name: dict(p) for name, p in effects.items()})
    unknowns = candidates.unknowns_of(bench, model, found.base)
    first = candidates.first_values(unknowns, model, found.base, near)
    kept = near.slopes if iterations == _QUICK else None
    return minimise(bench, model, near.starts, unknowns, first, kept, iterations)


def rebuild(found: SearchState, names: Sequence[str], result: Fit) -> SearchState:
    """What was found, as if these effects had been adopted one after the other, the last fit that of them all."""
    bench = copy(found.bench)
    fine = contest.refit_in_fine_limit(bench, result)
    bench, fine = contest.refit_with_own_noise(bench, found.best, fine)
    adopted: list[Candidate] = []
    rounds: list[tuple[Candidate, ...]] = []
    before = found.base
    for k, name in enumerate(names):
        last = k == len(names) - 1
        effects = {n: fine.model.effects[n] for n in (*found.known, *names[: k + 1])}
        here = fine if last else refit(found, effects, contest.FULL_ITERATIONS, fine, found.benches[0])
        picked = Candidate(
            tuple(effects), here, candidates.score_gain(bench if last else found.benches[0], before, here)
        )
        adopted.append(picked)
        rounds.append((picked, *(c for c in found.rounds[k] if c.effects[-1] != name)))
        before = here
    earlier = found.benches[: len(names)]
    return replace(
        found,
        adopted=tuple(adopted),
        rounds=tuple(rounds),
        thresholds=found.thresholds[: len(names)],
        by_chance=found.by_chance[: len(names)],
        draws=found.draws[: len(names)],
        benches=(*earlier, bench),
    )
