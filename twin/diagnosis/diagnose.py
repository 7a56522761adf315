"""The diagnosis: calibration, forward selection of effects round by round, revision, predictions, answer."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable
from dataclasses import replace

from threadpoolctl import threadpool_limits

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.diagnosis import (
    candidates,
    contest,
    declarations,
    dependence,
    fit_patch,
    link_functions,
    permutation,
    predict,
    remainder,
    revise,
    rules,
    unnamed,
)
from twin.diagnosis.answer import Diagnosis
from twin.diagnosis.conclude import conclude
from twin.diagnosis.plan import plans_for_pair
from twin.diagnosis.state import Round, SearchState, UnnamedFunction
from twin.effects import REGISTRY, EffectParameter
from twin.errors import checked_count, checked_number
from twin.estimation import jackknife, output_error, refine, repeated_fits, static_friction
from twin.estimation.calibrate import calibrate, likeliest_clock
from twin.estimation.fit import Fit
from twin.estimation.minimise import FAR_ITERATIONS, minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.executors.processes import MOST_PROCESSES
from twin.progress import Progress, silent
from twin.recording import HUB_TORQUE, ON_LINK
from twin.residuals.significance import FOLLOWS

MOST_EFFECTS = 3
"""Effects that are adopted at most."""
FALSE_ALARM_RATE = 0.01


def diagnose(
    campaign: Campaign,
    progress: Progress = silent,
    workers: int | None = None,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> Diagnosis:
    """Finds what a campaign's model lacks.

    Args:
      campaign: the recordings; held-out ones are simulated once, at the end.
      progress: called with a message at every stage.
      workers: number of threads, and of processes that compute residuals; by default one a processor.
      false_alarm_rate: upper bound of the probability that an effect is adopted where none is missing.

    Raises:
      InputError: the rate is not between 1/`permutation.DRAWS` and 0.5, or there cannot be so many threads.
    """
    checked_rate(false_alarm_rate)
    if workers is not None:
        checked_count("workers", workers, 1, MOST_PROCESSES)
    began = time.perf_counter()
    with threadpool_limits(1), ResidualPool(workers or os.cpu_count() or 1) as pool:
        state = search(campaign, pool, progress, false_alarm_rate)
        followed = not remainder.unexplained_channels(state)
        if followed:
            progress("reading the static friction")
        polished = _final_models(state, pool, followed, progress)
        progress("simulating every recording")
        predicted = predict.predict(campaign, state, polished, pool)
        pair = rules.closest_pair([r.ranked for r in state.adopting])
        plans = plans_for_pair(campaign, pair, pool) if pair else []
        left = dependence.unexplained_residuals(state.bench, state.best)
        patched, on_link = None, tuple[UnnamedFunction, ...]()
        if not followed:
            progress("describing what is outside the library")
            patched = fit_patch.fit_patch(campaign, state, left, polished, predicted, pool)
            on_link = link_functions.find_functions(state, false_alarm_rate)
        answer = conclude(campaign, state, left, polished, predicted, plans, patched, on_link)
    return replace(answer, false_alarm_rate=false_alarm_rate, wall_s=time.perf_counter() - began)


def checked_rate(false_alarm_rate: float) -> float:
    """Returns a false-alarm rate; raises InputError where the permutation test cannot have it."""
    return checked_number("false-alarm rate", false_alarm_rate, 1 / permutation.DRAWS, 0.5)


def _final_models(
    state: SearchState, pool: ResidualPool, followed: bool, progress: Progress
) -> static_friction.FinalModels:
    """The models that are reported; a fit to output errors has found the static friction already."""
    declared, best = state.start.declared, state.best
    if not state.on_output_errors:
        if state.adopted and repeated_fits.is_repeated(state.bench, best):
            progress("fitting simulations of the answer")
            best = repeated_fits.without_bias(state.bench, best)
        return static_friction.final_models(state.data, state.base, best, declared, pool, whole=followed)
    base = (
        state.base if state.best is state.base else static_friction.with_static_levels(state.data, state.base)
    )
    return static_friction.FinalModels(declared, base, best)


# Recordings are simulated side by side: threads of linear algebra beside them double the time.
@threadpool_limits.wrap(limits=1)
def search(
    campaign: Campaign,
    pool: ResidualPool,
    progress: Progress = silent,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> SearchState:
    """Searches the fit recordings for effects that the model lacks; arguments as `diagnose`, residuals in `pool`."""
    first = first_round(campaign, pool, progress, false_alarm_rate)
    first = continued_on_output_errors(*first, progress)
    state = _searched_to_end(*first, progress, false_alarm_rate)
    if state.on_output_errors or HUB_TORQUE not in remainder.unexplained_channels(state):
        return state
    begun = SearchState(state.start, state.adopting[:1])
    # Driven data smooth the motion of the hub, and an impact with it: what is missing in its balance may be hidden.
    progress("searching once more, with output errors")
    begun, more = on_output_errors(begun, True, progress)
    if not begun.on_output_errors:
        return state
    other = _searched_to_end(begun, more, progress, false_alarm_rate)
    # What explains most is worth more than nothing, with what is left beside it.
    explains_more = bool(other.adopted) and not state.adopted
    return other if explains_more or not remainder.unexplained_channels(other) else state


def _searched_to_end(
    state: SearchState, more: bool, progress: Progress, false_alarm_rate: float
) -> SearchState:
    """The state after the remaining rounds of the search, with errors and the test for smooth functions."""
    state = _searched_on(state, more, progress, false_alarm_rate)
    state = _in_own_limit(revise.with_closer_free_runs(state))
    progress("computing standard errors")
    state, sound = on_sound_channels(state)
    state = with_errors(state, sound)
    progress("testing for torques outside the library")
    return _final_state(state, sound, progress, false_alarm_rate)


def _in_own_limit(state: SearchState) -> SearchState:
    """The state with the data corrected for the discretisation error of its final model."""
    if not state.adopted or state.on_output_errors:
        return state
    bench, best = contest.refit_in_own_limit(state.bench, state.best)
    return state.with_last_fit(best, bench)


def _searched_on(state: SearchState, more: bool, progress: Progress, false_alarm_rate: float) -> SearchState:
    """The state after the remaining rounds of the search."""
    # More rounds than effects: revision may remove an effect.
    for _ in range(2 * MOST_EFFECTS - 1):
        if not more or len(state.adopted) == MOST_EFFECTS or not _can_gain(state):
            break
        tried = state.best
        state, more = next_round(state, progress, false_alarm_rate)
        if state.best is not tried:
            state, more = continued_on_output_errors(state, more, progress)
    return state


def _final_state(
    state: SearchState, sound: Workbench, progress: Progress, false_alarm_rate: float
) -> SearchState:
    """The state at the end of the search, revised in one of two ways if one is justified.

    Effects of undetermined size are withdrawn, and the search goes on without them: what they imitate may be another
    effect, which was second to them. Otherwise a declared parameter that the recordings contradict becomes an
    effect where all else is explained.
    """
    fewer = revise.without_undetermined(state)
    if fewer is not None:
        if _can_gain(fewer) and len(fewer.undetermined) > len(state.undetermined):
            again = replace(fewer, rounds=fewer.adopting)
            return _searched_to_end(again, True, progress, false_alarm_rate)
        return with_unnamed(with_errors(fewer, fewer.bench), fewer.bench, false_alarm_rate)
    state = with_unnamed(with_whole_orders(state, sound), sound, false_alarm_rate)
    if len(state.adopted) < MOST_EFFECTS:
        more = declarations.with_contradicted_declaration(state, false_alarm_rate)
        if more is not None:
            return with_unnamed(with_errors(more, more.bench), more.bench, false_alarm_rate)
    return state


def with_unnamed(state: SearchState, bench: Workbench, false_alarm_rate: float) -> SearchState:
    """The state with the test for smooth functions in the residuals of these data."""
    if state.on_output_errors and not remainder.large_residuals(state):
        # The hub integrates every torque: nothing is left that a function could explain.
        return replace(state, unnamed=())
    driven, best = output_error.on_driven_data(bench, state.best)
    return replace(state, unnamed=unnamed.find_functions(driven, best, false_alarm_rate))


def with_whole_orders(state: SearchState, bench: Workbench) -> SearchState:
    """The state with orders at whole numbers where these data allow it."""
    best = revise.with_whole_orders(bench, state.best)
    return state if best is state.best else state.with_last_fit(_with_covariance(bench, best))


def first_round(
    campaign: Campaign, pool: ResidualPool, progress: Progress, false_alarm_rate: float
) -> tuple[SearchState, bool]:
    """The first round of the search, as `next_round`; repeated if the adopted effect changes the likeliest clock."""
    start = calibrate(campaign, pool, progress)
    state, more = next_round(SearchState(start), progress, false_alarm_rate)
    if state.adopted:
        progress("fitting the clock of the commands")
        clock = likeliest_clock(start, state.best)
        if clock != start.clock:
            start = calibrate(campaign, pool, progress, clock=clock)
            return next_round(SearchState(start), progress, false_alarm_rate)
    return state, more


def continued_on_output_errors(
    state: SearchState, more: bool, progress: Progress
) -> tuple[SearchState, bool]:
    """The state with its last fit repeated on output errors, and whether to go on.

    They are used where the noise of the hub sensor dominates, or where they are explained and leave less misfit than
    the driven data: with rough sensors they tell parameters many times better. Not to replace those of a play, whose
    impacts take ten times as many steps. Whether it dominates is asked of the calibrated model: noise that excites an
    adopted effect is none of the sensor.
    """
    if state.on_output_errors or output_error.hub_sensor_dominates(state.start.bench):
        return on_output_errors(state, more, progress)
    if _has_play(state.best):
        return state, more
    return on_output_errors(state, more, progress, FOLLOWS)


def _has_play(fit: Fit) -> bool:
    return fit.model.plant.motor.gap > 0


def on_output_errors(
    state: SearchState, more: bool, progress: Progress, largest: float = math.inf
) -> tuple[SearchState, bool]:
    """The state with its last fit repeated on output errors, and whether to go on.

    Args:
      state: of the search.
      more: whether to go on where output errors are not used.
      progress: called with a message.
      largest: residual of a block from which on output errors are not used [noise levels]; if it is finite, they also
        have to leave less misfit than the data of the last fit.
    """
    progress("fitting output errors")
    most = state.bench.misfit(state.best.residual) if largest < math.inf else math.inf
    found = output_error.fit_output_error(state.bench, state.best, most)
    if found is None:
        return state, more
    bench, fit = found
    if bench.sizes(fit.residual).max(initial=0.0) >= largest or bench.misfit(fit.residual) > most:
        return state, more
    state = state.with_last_fit(fit, bench)
    if state.adopted:
        state = revise.revise(replace(state, rounds=state.adopting), progress)
    more = _can_gain(state)
    return (replace(state, rounds=state.adopting) if more else state), more


def _can_gain(state: SearchState) -> bool:
    """Whether the misfit exceeds the least score: an effect explains no more than what is left.

    The likelihood also grows where residuals below the noise level shrink further; that explains nothing.
    """
    return state.bench.misfit(state.best.residual) > rules.MODEL_ERROR_SCORE


def next_round(state: SearchState, progress: Progress, false_alarm_rate: float) -> tuple[SearchState, bool]:
    """One round of the search; the state after it, and whether an effect was adopted."""
    bench, current = state.bench, state.best
    able = candidates.candidate_names(current.model, bench.channels())
    names = [name for name in able if name not in state.undetermined]
    explored = candidates.explore(bench, current, names, progress)
    progress("permutation test")
    draws = permutation.permutation_scores(bench, current, explored.slopes)
    by_chance, ranked = permutation.threshold(draws, false_alarm_rate), explored.ranked
    if ranked and ranked[0].score > rules.MODEL_ERROR_SCORE and _can_gain(state):
        ranked = contest.fit_to_convergence(bench, current, ranked, progress)
        better = contest.better_calibration(bench, current, ranked[0])
        if better is not None:
            state, gained = state.with_last_fit(better), current.cost - better.cost
            if any(ranked[0].score - c.score <= gained for c in ranked[1:]):
                progress("repeating the round with a better calibration")
                return next_round(state, progress, false_alarm_rate)
            # No other candidate can come first: their scores contain the gain of the calibration, too.
            current, ranked = better, [replace(c, score=c.score - gained) for c in ranked]
    ranked, choice, confirmed = contest.confirm_in_fine_limit(bench, current, ranked, by_chance, state.gained)
    judgements = contest.judge_round(confirmed, current, ranked, by_chance, state.gained)
    threshold = max(by_chance, rules.least_score(state.gained))
    done = Round(tuple(c.stored() for c in ranked), by_chance, threshold, draws, judgements)
    if choice is None:
        return state.with_round(done), False
    progress(f"adopting {labels.words(choice.name)}")
    bench, current = contest.refit_with_own_noise(confirmed, current, choice.fit)
    done = replace(done, adopted=replace(choice, fit=current), bench=bench)
    return revise.revise(state.with_round(done), progress), True


def on_sound_channels(state: SearchState) -> tuple[SearchState, Workbench]:
    """The state with its last fit repeated without faulty sensors of the link, and the data of that fit.

    Faulty is a sensor whose residuals are not explained while those of another sensor of the link are: the parameters
    would be fitted to its fault. If no sensor of the link is explained, the fault may be in the link, and all are kept.
    An effect on a sensor whose residuals it does not explain is withdrawn.
    """
    bench, best = state.bench, state.best
    link = bench.channels() & set(ON_LINK)
    faulty = link & set(remainder.unexplained_channels(state))
    if state.adopted and _sensors_of(state.adopted[-1].name) & faulty:
        return on_sound_channels(_without_last(state))
    if not faulty or faulty == link or faulty & {u.channel for u in _parameters(best.model.effects)}:
        return state, bench
    sound = bench.without_channels(faulty)
    again = minimise(sound, best.model, best.starts, best.unknowns, best.values, iterations=FAR_ITERATIONS)
    return state.with_last_fit(again), sound


def _without_last(state: SearchState) -> SearchState:
    """The state without the effect that was adopted last."""
    *kept, last = state.adopting
    undone = [last.without_adoption()] if state.last is not None else []
    return replace(state, rounds=(*kept, *undone))


def with_errors(state: SearchState, bench: Workbench) -> SearchState:
    """The state with covariances of its last fit, for these data, and of the calibration."""
    best = _with_covariance(bench, state.best)
    if state.adopted:
        calibrated = jackknife.with_jackknife_covariance(state.start.bench, state.base)
        state = replace(state, start=replace(state.start, base=calibrated))
    return state.with_last_fit(best)


def _with_covariance(bench: Workbench, best: Fit) -> Fit:
    """The fit refined along poorly determined directions, with its covariance.

    Where the common scale of inertias and stiffnesses is determined by their declared uncertainty alone, the optimiser
    stops before the minimum.
    """
    likeliest, by_start = repeated_fits.likeliest_with_scatter(bench, best)
    smooth, by_roughness = refine.refined_with_roughness(bench, likeliest)
    sure = jackknife.with_jackknife_covariance(bench, smooth)
    return replace(sure, covariance=sure.covariance + by_roughness + by_start)


def _parameters(names: Iterable[str]) -> list[EffectParameter]:
    return [p for name in names for p in REGISTRY[name].parameters]


def _sensors_of(name: str) -> set[str | None]:
    """Channels that an effect on sensors changes; empty for any other effect."""
    channels = {p.channel for p in _parameters([name])}
    return set() if None in channels else channels
