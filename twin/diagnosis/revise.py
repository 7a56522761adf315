"""Revision of adopted effects: removed, exchanged, or set to a whole order.

An effect is adopted while others are still missing, and may have gained by imitating them. So it is removed if it is
needless beside later ones, exchanged if a close candidate of its round is better beside later ones, and withdrawn if
its size is not determined. An order over the hub angle is set to a whole number if the recordings allow it: a motor's
magnets, a bearing or an encoder disc repeat after one turn. Behind a belt or a gear an order may be any number; then
the recordings have to show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import approx_fprime

from twin.diagnosis import candidates, contest, fit_start, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement
from twin.diagnosis.rules import (
    NEEDED,
    REPLACEABLE,
    SIZE_DETERMINED,
    Standing,
)
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY
from twin.estimation import jackknife
from twin.estimation.fit import Fit
from twin.estimation.minimise import FAR_ITERATIONS, QUICK_ITERATIONS, minimise
from twin.estimation.slopes import normal_equations
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent
from twin.residuals.significance import SIGNIFICANT

_CLOSE = 0.8  # share of the best score of a round from which another candidate may replace the adopted one


def revise(state: SearchState, progress: Progress = silent) -> SearchState:
    """The state with an earlier effect exchanged or removed, if the later ones justify it."""
    if len(state.adopted) < 2:
        return state
    progress("revising the adopted effects")
    return _without_needless(_exchanged(state))


def _without_needless(state: SearchState) -> SearchState:
    """The state without the effect whose removal costs least score, if it fails `needed-beside-later`."""
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
    """The fit without one effect; given up where the loss of score would stay above `least`."""
    effects = {n: p for n, p in state.best.model.effects.items() if n != name}
    quick = refit(state, effects, QUICK_ITERATIONS, state.best)
    fewer = len(state.best.unknowns) - len(quick.unknowns)
    goal = state.best.cost + least + state.bench.penalty(fewer)
    return refit(state, effects, FAR_ITERATIONS, quick, goal=goal)


def _exchanged(state: SearchState) -> SearchState:
    """The state with the effect of an earlier round exchanged for a close candidate, if this raises the score."""
    effects = state.best.model.effects
    best, closest, reason = None, state.best, {}
    for adopted, earlier in zip(state.names[:-1], state.rounds, strict=False):
        for other in _close_candidates(earlier):
            if other.name in effects:
                continue
            tried = {other.name if n == adopted else n: p for n, p in effects.items()}
            tried[other.name] = other.fit.model.effects[other.name]
            result = refit(state, tried, QUICK_ITERATIONS, state.best)
            fewer = len(closest.unknowns) - len(result.unknowns)
            gained = closest.cost - result.cost + state.bench.penalty(fewer)
            judgement = REPLACEABLE.judge(Standing(gained, earlier.ranked[0].score))
            if not judgement.passed:
                best, closest = [n for n in tried if n not in state.known], result
                reason = {adopted: judgement}
    return state if best is None else rebuild(state, best, closest, reason)


def with_closer_free_runs(state: SearchState) -> SearchState:
    """The state with an effect exchanged for one that was tied with it in its round, if free runs clearly prefer it.

    Free runs are compared with all effects in the models: what a later effect explains would decide them otherwise.
    """
    if state.on_output_errors:
        return state
    for k in range(len(state.adopted)):
        ranked = _tied_models(state, k)
        first, *others = contest.prefer_closer_free_runs(state.bench, ranked)
        if first.name != ranked[0].name:
            names = [first.name if i == k else name for i, name in enumerate(state.names)]
            state = rebuild(state, names, first.fit)
        # What free runs have told apart is tied no longer.
        told = {c.name: c.score for c in others}
        decided = state.rounds[k]
        ranked = [replace(c, score=min(c.score, told.get(c.name, c.score))) for c in decided.ranked]
        rounds = [replace(r, ranked=tuple(ranked)) if r is decided else r for r in state.rounds]
        state = replace(state, rounds=tuple(rounds))
    return state


def _tied_models(state: SearchState, k: int) -> list[Candidate]:
    """The adopted model, then those with another candidate that round k allowed and that was tied with it, fitted."""
    adopted, decided, best = state.adopted[k], state.adopting[k], state.best
    kept = {n: p for n, p in best.model.effects.items() if n != adopted.name}
    tied = [Candidate((*kept, adopted.name), best, adopted.score)]
    least = adopted.score - rules.decisive_difference(adopted.score)
    for other in decided.ranked[: candidates.CONTENDERS]:
        if other.score > least and decided.allows(other) and other.name not in best.model.effects:
            effects = {**kept, other.name: other.fit.model.effects[other.name]}
            fit = refit(state, effects, QUICK_ITERATIONS, best)
            tied.append(Candidate(tuple(effects), fit, other.score))
    return tied


def _close_candidates(earlier: Round) -> list[Candidate]:
    """Candidates that the rules of a round allowed, and whose scores are close to the best."""
    best = earlier.ranked[0].score
    least = min(_CLOSE * best, best - rules.decisive_difference(best))
    return [c for c in earlier.ranked[1 : candidates.CONTENDERS] if c.score > least and earlier.allows(c)]


def refit(
    state: SearchState,
    effects: Mapping[str, Mapping[str, float]],
    iterations: int,
    near: Fit,
    bench: Workbench | None = None,
    goal: float = np.inf,
) -> Fit:
    """Fits a model with these effects, starting at the values of another fit.

    Args:
      state: of the search.
      effects: of the model: name -> parameter -> value, SI.
      iterations: maximum; with `QUICK_ITERATIONS`, the Jacobian of `near` is kept.
      near: the other fit.
      bench: the data; by default those of the state.
      goal: see `minimise`.
    """
    bench = bench or state.bench
    model = near.model.replace(effects={name: dict(p) for name, p in effects.items()})
    model = fit_start.without_replaced_errors(model)
    unknowns = fit_start.fit_unknowns(bench, model, state.base)
    first = fit_start.initial_values_near(bench, unknowns, model, state.base, near)
    kept = near.jacobian_columns if iterations == QUICK_ITERATIONS else None
    return minimise(bench, model, near.starts, unknowns, first, kept, iterations, goal=goal)


def rebuild(
    state: SearchState, names: Sequence[str], result: Fit, reason: Mapping[str, Judgement] | None = None
) -> SearchState:
    """The state as if these effects had been adopted one after the other.

    Args:
      state: of the search.
      names: of the effects, in their order.
      result: the fit of all of them.
      reason: withdrawn effect -> the judgement by which it was withdrawn.
    """
    reason = reason or {}
    bench, fine = contest.refit_in_fine_limit(state.bench, result)
    bench, fine = contest.refit_with_own_noise(bench, state.best, fine)
    *earlier, last = (_rebuilt_round(state, names[: k + 1], fine, bench, reason) for k in range(len(names)))
    adopted = replace(last.ranked[0], fit=fine)
    last = replace(last, ranked=(adopted, *last.ranked[1:]), adopted=adopted, bench=bench)
    return state.with_adoptions([*earlier, last], reason)


def _rebuilt_round(
    state: SearchState, names: Sequence[str], fine: Fit, bench: Workbench, reason: Mapping[str, Judgement]
) -> Round:
    """The round of the last of these effects as if it had been adopted beside the others.

    It is that in which the effect was adopted, or that of the effect in whose place it is. Its score is by fits to the
    data of that round: what is left of driven data cannot be compared with output errors. Other candidates keep their
    distance from it: their scores are beside the effects of that round, which may have been withdrawn since.

    Args:
      state: of the search.
      names: of the effects until then.
      fine: the fit of all effects that stay.
      bench: the data of that fit.
      reason: effect that was withdrawn -> its judgement.
    """
    by_name = {adopted.name: r for r, adopted in zip(state.adopting, state.adopted, strict=True)}
    own = by_name.get(names[-1], state.adopting[len(names) - 1])
    data = bench if own.bench in (None, state.bench) else own.bench

    def fitted(kept: Sequence[str]) -> Fit:
        effects = {n: fine.model.effects[n] for n in (*state.known, *kept)}
        if data is bench and len(effects) == len(fine.model.effects):
            return fine
        return refit(state, effects, FAR_ITERATIONS, fine, data)

    before, here = fitted(names[:-1]), fitted(names)
    adopted = Candidate((*state.known, *names), here, candidates.score_gain(data, before, here))
    told = adopted.score - rules.decisive_difference(adopted.score)
    moved = adopted.score - next((c.score for c in own.ranked if c.name == names[-1]), own.ranked[0].score)
    others = [
        replace(c, score=min(c.score + moved, told) if c.name in reason else c.score + moved)
        for c in own.ranked
        if c.name not in names
    ]
    ranked = (adopted, *sorted(others, key=lambda c: -c.score))
    return replace(own, ranked=ranked, adopted=adopted, bench=data)


def without_undetermined(state: SearchState) -> SearchState | None:
    """The state without effects whose sizes are not determined; None if all are.

    Two wrong laws may add up to a right one: a spring and a cogging torque of two periods a turn imitate a hardening
    spring. Their sizes are then nearly collinear, so that neither differs from neutral by three standard errors, and
    each alone explains little. If one of them explains what both do, it is kept alone.

    Args:
      state: whose last fit has its standard errors.
    """
    reason = _undetermined(state, state.best)
    if not reason:
        return None
    told = [name for name in state.names if name not in reason]
    alone = _one_of(state, told, list(reason)) if len(reason) > 1 else None
    if alone is not None:
        return rebuild(state, *alone, {n: j for n, j in reason.items() if n not in alone[0]})
    if told:
        return rebuild(state, told, _fit_of(state, told), reason)
    return state.with_adoptions([state.rounds[0].without_adoption()], reason)


def _undetermined(state: SearchState, best: Fit) -> dict[str, Judgement]:
    """Adopted effect of a fit -> the judgement of its size, of those whose size is not determined."""
    names = [name for name in state.names if name in best.model.effects]
    judged = {name: SIZE_DETERMINED.judge(Standing(size=size_in_errors(best, name))) for name in names}
    return {name: judgement for name, judgement in judged.items() if not judgement.passed}


def _one_of(state: SearchState, told: Sequence[str], names: Sequence[str]) -> tuple[list[str], Fit] | None:
    """The effects and the fit in which one of some undetermined effects does as well as all; None without any."""
    least = NEEDED.limit(Standing(0.0, state.gained))
    for name in names:
        kept = [n for n in state.names if n in told or n == name]
        fit = jackknife.with_jackknife_covariance(state.bench, _fit_of(state, kept))
        if candidates.score_gain(state.bench, fit, state.best) < least and not _undetermined(state, fit):
            return kept, fit
    return None


def _fit_of(state: SearchState, names: Sequence[str]) -> Fit:
    """The fit of the model with these of the adopted effects alone."""
    effects = {name: state.best.model.effects[name] for name in (*state.known, *names)}
    return refit(state, effects, FAR_ITERATIONS, state.best)


def size_in_errors(best: Fit, name: str) -> float:
    """Distance of an effect from neutral in standard errors, the largest of its parameters that vanish at neutral.

    0 if any of its parameters is at the end of its range: then the law is not that of the effect, as of a mode that
    hardly oscillates, or its size is that of the range. What a sensor reads of an effect on the rig is not its size. Of
    an effect that is linear in some coefficients, their joint distance counts: that of each alone is small where the
    standard error of the other makes it so, as of a cable and its rest angle.
    """
    effect = REGISTRY[name]
    neutral = effect.neutral(best.model.declared)
    moving = [p for p in effect.parameters if p.name not in effect.undefined_at_neutral]
    at_neutral = {p.name: p.turned(neutral[p.name]) for p in moving}
    own = {p.name for p in moving if p.channel is None} or set(at_neutral)
    sizes = [SIGNIFICANT] if not at_neutral else []
    for u, value, error in zip(best.unknowns, best.values, best.errors, strict=True):
        if u.effect == name and is_at_end(u, value):
            return 0.0
        if u.effect == name and u.name in own:
            sizes.append(abs(value - at_neutral[u.name]) / error if error > 0 else 0.0)
    return max(*sizes, _joint_size(best, name), 0.0)


def _joint_size(best: Fit, name: str) -> float:
    """Root of the Wald statistic of the coefficients in which an effect is linear; 0 where there are none."""
    effect, values = REGISTRY[name], dict(best.model.effects[name])
    coefficients = np.array(effect.linear_coefficients(values))
    fitted = [k for k, u in enumerate(best.unknowns) if u.effect == name and not u.inverse]
    if not coefficients.size or not fitted:
        return 0.0
    names = [best.unknowns[k].name for k in fitted]

    def at(x: np.ndarray) -> np.ndarray:
        return np.array(effect.linear_coefficients({**values, **dict(zip(names, x.tolist(), strict=True))}))

    J = np.atleast_2d(approx_fprime(best.values[fitted], at))
    covariance = J @ best.covariance[np.ix_(fitted, fitted)] @ J.T
    return float(np.sqrt(max(coefficients @ np.linalg.pinv(covariance, hermitian=True) @ coefficients, 0.0)))


def is_at_end(u: Unknown, value: float) -> bool:
    """Whether the value of an unknown is at a bound; one of 0 is physical, as of a friction, or of a compliance."""
    ends = u.bounds[1:] if u.inverse else u.bounds
    return any(end != 0 and bool(np.isclose(value, end)) for end in ends)


def with_whole_orders(bench: Workbench, best: Fit) -> Fit:
    """The fit with each order over the hub angle at the nearest whole number, if this costs less than one parameter."""
    for u in best.unknowns:
        if _is_order(u):
            whole = _at_whole(bench, best, u)
            if whole.cost < best.cost + bench.penalty(1):
                best = whole
    return best


def _is_order(u: Unknown) -> bool:
    effect = REGISTRY.get(u.effect)
    return (
        effect is not None
        and effect.wave is not None
        and effect.wave.by_angle
        and u.name == effect.wave.order
    )


def _at_whole(bench: Workbench, best: Fit, order: Unknown) -> Fit:
    """The fit with an order fixed at the nearest whole number."""
    index = best.unknowns.index(order)
    kept = [k for k in range(len(best.unknowns)) if k != index]
    unknowns = [best.unknowns[k] for k in kept]
    whole = float(np.round(best.values[index]))
    values = best.values[kept] + _conditional_slope(bench, best, index)[kept] * (whole - best.values[index])
    effects = {name: dict(p) for name, p in best.model.effects.items()}
    effects[order.effect][order.name] = whole
    model = best.model.replace(effects=effects)
    return minimise(bench, model, best.starts, unknowns, values, best.jacobian_columns, QUICK_ITERATIONS)


def _conditional_slope(bench: Workbench, best: Fit, index: int) -> np.ndarray:
    """Derivative of the maximum-likelihood values of all unknowns (p) by the value of one that is fixed."""
    information, _ = normal_equations(bench, best)
    covariance = np.linalg.pinv(information, hermitian=True)
    variance = covariance[index, index]
    return covariance[:, index] / variance if variance > 0 else np.zeros(len(best.unknowns))
