"""Adopted effects looked at again: needless beside a later one, an exchangeable first pick, or of untold size.

An effect is adopted while others are still missing, and may have gained by standing in for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin.diagnosis import candidates, contest, remainder, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement
from twin.diagnosis.rules import NEEDED, REPLACEABLE, SIZE_TOLD, TOLD, Standing
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent

_QUICK = 5  # iterations of a fit that only tells whether a full one is worth while
_FAR = 10.0  # times the least score from which such a fit is enough to keep an effect
_ALIKE = 0.8  # share of the best score from which another candidate of a round may take its place later
_FUNCTION_PARAMETERS = 2  # numbers that a smooth function was fitted by: its size and its length


def revise(state: SearchState, progress: Progress = silent) -> SearchState:
    """The state after later effects have been allowed to replace an earlier one, or to make it needless."""
    if len(state.adopted) < 2:
        return state
    progress("looking back at what was adopted")
    return _without_needless(_exchanged(state))


def _without_needless(state: SearchState) -> SearchState:
    """The state without the effect that the model loses least by, if that is less than `needed-beside-later` asks."""
    names = state.names
    least = NEEDED.limit(Standing(0.0, state.gained))
    without = {name: _fit_without(state, name, least) for name in names[:-1]}
    losses = {name: candidates.score_gain(state.bench, fit, state.best) for name, fit in without.items()}
    needless = min(losses, key=lambda name: losses[name])
    judgement = NEEDED.judge(Standing(losses[needless], state.gained))
    if judgement.passed:
        return state
    kept = [n for n in names if n != needless]
    return rebuild(state, kept, without[needless], {needless: judgement})


def _fit_without(state: SearchState, name: str, least: float) -> Fit:
    """The fit of all effects but one; to convergence where its loss is not clearly above `least`."""
    effects = {n: p for n, p in state.best.model.effects.items() if n != name}
    quick = refit(state, effects, _QUICK, state.best)
    if candidates.score_gain(state.bench, quick, state.best) > _FAR * least:
        return quick
    return refit(state, effects, contest.FULL_ITERATIONS, quick)


def _exchanged(state: SearchState) -> SearchState:
    """The state with another candidate of an earlier round in the place of its winner, if it explains more by now."""
    effects = state.best.model.effects
    best, closest, reason = None, state.best, {}
    for pick, earlier in zip(state.names[:-1], state.rounds, strict=False):
        for other in _close_candidates(earlier.ranked):
            if other.name in effects:
                continue
            tried = {other.name if n == pick else n: p for n, p in effects.items()}
            tried[other.name] = other.fit.model.effects[other.name]
            result = refit(state, tried, _QUICK, state.best)
            fewer = len(closest.unknowns) - len(result.unknowns)
            gained = closest.cost - result.cost + candidates.price(fewer, state.bench)
            judgement = REPLACEABLE.judge(Standing(gained, earlier.ranked[0].score))
            if not judgement.passed:
                best, closest = [n for n in tried if n not in state.known], result
                reason = {pick: judgement}
    return state if best is None else rebuild(state, best, closest, reason)


def _close_candidates(ranked: Sequence[Candidate]) -> list[Candidate]:
    """Fitted candidates of a round that explained nearly as much as its winner."""
    best = ranked[0].score
    least = min(_ALIKE * best, best - rules.decisive_difference(best))
    return [c for c in ranked[1 : contest.CONTENDERS] if c.score > least and c.is_fitted]


def refit(
    state: SearchState,
    effects: Mapping[str, Mapping[str, float]],
    iterations: int,
    near: Fit,
    bench: Workbench | None = None,
) -> Fit:
    """Fits a model with these effects, from the values of another fit.

    Args:
      state: of the search.
      effects: of the model: name -> parameter -> value, SI.
      iterations: at most so many; with few, the slopes of `near` are kept.
      near: the other fit.
      bench: the data; by default those of the state.
    """
    bench = bench or state.bench
    model = near.model.replace(effects={name: dict(p) for name, p in effects.items()})
    unknowns = candidates.unknowns_of(bench, model, state.base)
    first = candidates.first_values(unknowns, model, state.base, near)
    kept = near.jacobian_columns if iterations == _QUICK else None
    return minimise(bench, model, near.starts, unknowns, first, kept, iterations)


def rebuild(
    state: SearchState, names: Sequence[str], result: Fit, reason: Mapping[str, Judgement] | None = None
) -> SearchState:
    """The state as if these effects had been adopted one after the other.

    Args:
      state: of the search.
      names: of the effects, in their order.
      result: the fit of all of them.
      reason: effect that is withdrawn -> the judgement that says why.
    """
    bench, fine = contest.refit_in_fine_limit(state.bench, result)
    bench, fine = contest.refit_with_own_noise(bench, state.best, fine)
    rounds: list[Round] = []
    before = state.base
    for k, name in enumerate(names):
        last = k == len(names) - 1
        effects = {n: fine.model.effects[n] for n in (*state.known, *names[: k + 1])}
        seen = bench if last else state.start.bench
        here = fine if last else refit(state, effects, contest.FULL_ITERATIONS, fine, seen)
        adopted = Candidate(tuple(effects), here, candidates.score_gain(seen, before, here))
        others = (c for c in state.rounds[k].ranked if c.name != name)
        own = bench if last else state.rounds[k].bench
        ranked = (adopted, *others)
        rounds.append(replace(state.rounds[k], ranked=ranked, adopted=adopted, bench=own))
        before = here
    return state.with_adoptions(rounds, reason or {})


def without_untold(state: SearchState) -> SearchState | None:
    """The state without effects whose sizes are not told, if there are two or more; None otherwise.

    Two wrong laws may add up to a right one: a spring and a cogging of two periods a turn to a spring that gets
    stiffer, each as large as one likes as long as the other takes it away again. The size of a right one is told.

    Args:
      state: whose last fit has its standard errors.
    """
    sizes = {name: size_in_errors(state.best, name) for name in state.names}
    untold = sum(size < TOLD for size in sizes.values())
    judged = {name: SIZE_TOLD.judge(Standing(size=size, untold=untold)) for name, size in sizes.items()}
    reason = {name: judgement for name, judgement in judged.items() if not judgement.passed}
    if not reason:
        return None
    names = [name for name in state.names if name not in reason]
    if names:
        effects = {name: state.best.model.effects[name] for name in (*state.known, *names)}
        fit = refit(state, effects, contest.FULL_ITERATIONS, state.best)
        return rebuild(state, names, fit, reason)
    return state.with_adoptions([state.rounds[0].without_adoption()], reason)


def size_in_errors(best: Fit, name: str) -> float:
    """Distance of an effect from neutral in standard errors, by the best told of its parameters that move it there."""
    effect = REGISTRY[name]
    neutral = effect.neutral(best.model.declared)
    open_ends = {p.name: p.turned(neutral[p.name]) for p in effect.parameters if p.name not in effect.along}
    return max(
        (
            abs(value - open_ends[u.name]) / error if error > 0 else 0.0
            for u, value, error in zip(best.unknowns, best.values, best.errors, strict=True)
            if u.effect == name and u.name in open_ends
        ),
        default=TOLD,
    )


def named_instead(state: SearchState) -> SearchState | None:
    """The state with an effect in the place of the significant function that explains no more; None without one.

    A small effect can be too little to be told from the model's own error by its score, and still be a smooth function
    of one variable wherever that comes back. Something is missing then; which of the two it is, is decided by their
    likelihoods, each fitted number at its price.

    Args:
      state: all of whose recordings are explained but for such a function, if any.
    """
    smooth, last = remainder.significant_function(state), state.last
    if smooth is None or remainder.large_residuals(state) or last is None or not _has_fitted_best(last):
        return None
    least = max(smooth.evidence - candidates.price(_FUNCTION_PARAMETERS, state.bench), last.by_chance)
    # What was not worth adopting was only fitted quickly.
    ranked = contest.fit_to_convergence(state.bench, state.best, last.ranked)
    choice = ranked[0]
    gained = rules.gain_without_best_recording(state.bench, state.best, choice)
    if choice.score < least or gained <= 0:
        return None
    bench, fine = contest.refit_in_fine_limit(state.bench, choice.fit)
    choice = replace(choice, fit=fine, score=candidates.score_gain(bench, state.best, fine))
    if choice.score < least:
        return None
    bench, seen = contest.refit_with_own_noise(bench, state.best, fine)
    adopting = replace(
        last,
        ranked=(choice, *ranked[1:]),
        threshold=least,
        adopted=replace(choice, fit=seen),
        bench=bench,
    )
    return replace(state, rounds=(*state.rounds[:-1], adopting), instead=smooth)


def _has_fitted_best(last: Round) -> bool:
    return bool(last.ranked) and last.ranked[0].score > 0 and last.ranked[0].is_fitted
