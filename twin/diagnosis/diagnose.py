"""The search for missing effects: calibrate, add the effect that explains most, round by round; then the answer."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from threadpoolctl import threadpool_limits

from twin.campaigns.campaign import Campaign
from twin.diagnosis import (
    candidates,
    chance,
    contest,
    dependence,
    fit_patch,
    predict,
    remainder,
    revise,
    rules,
    unnamed,
    whole_orders,
)
from twin.diagnosis.answer import Diagnosis
from twin.diagnosis.conclude import conclude
from twin.diagnosis.plan import planned
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY, EffectParameter
from twin.errors import InputError
from twin.estimation import jackknife, refine, static_friction
from twin.estimation.calibrate import calibrate, likeliest_clock
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.workbench import Workbench
from twin.progress import Progress, silent

MOST_EFFECTS = 3
MOST_ROUNDS = 6
"""Of the search: an effect that is dropped for a later one makes room for another round."""
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
      progress: told of every stage.
      workers: number of threads; by default one a processor.
      false_alarm_rate: how often something may be found where nothing is missing, 0 to 1.

    Raises:
      InputError: the rate is not between 1/`chance.DRAWS` and 0.5.
    """
    least = 1 / chance.DRAWS
    if not least <= false_alarm_rate <= 0.5:
        raise InputError(f"false-alarm rate is {false_alarm_rate:g}; expected {least:g} to 0.5")
    began = time.perf_counter()
    with threadpool_limits(1), ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        state = search(campaign, pool, progress, false_alarm_rate)
        followed = not remainder.unexplained_channels(state)
        if followed:
            progress("reading the static friction")
        polished = static_friction.final_models(
            state.data, state.base, state.best, state.start.declared, pool, whole=followed
        )
        progress("simulating every recording")
        predicted = predict.predict(campaign, state, polished, pool)
        pair = rules.closest_pair([r.ranked for r in state.adopting])
        plans = planned(campaign, pair, pool) if pair else []
        left = dependence.unexplained_residuals(state.bench, state.data, state.best)
        patched = None if followed else fit_patch.fit_patch(campaign, state, left, polished, predicted, pool)
    answer = conclude(campaign, state, left, polished, predicted, plans, patched)
    return replace(answer, false_alarm_rate=false_alarm_rate, wall_s=time.perf_counter() - began)


# Recordings are simulated side by side: threads of linear algebra beside them double the time.
@threadpool_limits.wrap(limits=1)
def search(
    campaign: Campaign,
    pool: ThreadPoolExecutor,
    progress: Progress = silent,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> SearchState:
    """Searches the fit recordings for effects that the model lacks; arguments as `diagnose`, threads in `pool`."""
    state, more = first_round(campaign, pool, progress, false_alarm_rate)
    for _ in range(MOST_ROUNDS - 1):
        if not more or len(state.adopted) == MOST_EFFECTS:
            break
        state, more = next_round(state, progress, false_alarm_rate)
    progress("telling how sure it is")
    state, sound = on_sound_channels(state)
    state = with_errors(state, sound)
    progress("asking what has no name")
    return _with_what_is_left(state, sound, false_alarm_rate)


def _with_what_is_left(state: SearchState, sound: Workbench, false_alarm_rate: float) -> SearchState:
    """The state at the end of the search: of three, the first that the rules allow.

    Without effects of untold size, if a fault outside the library is left then; with an effect in the place of a
    smooth function, if that leaves nothing; as it is.
    """
    told = revise.without_untold(state)
    if told is not None:
        told = with_unnamed(with_errors(told, told.bench), told.bench, false_alarm_rate)
        if remainder.unexplained_channels(told):
            return told
    state = with_unnamed(with_whole_orders(state, sound), sound, false_alarm_rate)
    named = revise.named_instead(state)
    if named is None:
        return state
    named = with_whole_orders(with_errors(named, named.bench), named.bench)
    named = with_unnamed(named, named.bench, false_alarm_rate)
    return state if remainder.unexplained_channels(named) else named


def with_unnamed(state: SearchState, bench: Workbench, false_alarm_rate: float) -> SearchState:
    """The state with the smooth functions that may be behind what is left of these data."""
    return replace(state, unnamed=unnamed.find_functions(bench, state.best, false_alarm_rate))


def with_whole_orders(state: SearchState, bench: Workbench) -> SearchState:
    """The state with orders at whole numbers where these data do not say otherwise."""
    best = whole_orders.with_whole_orders(bench, state.best)
    return state if best is state.best else state.with_last_fit(_with_covariance(bench, best))


def first_round(
    campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress, false_alarm_rate: float
) -> tuple[SearchState, bool]:
    """The first round of the search, as `next_round`; done again on another clock if the adopted effect asks for it."""
    start = calibrate(campaign, pool, progress)
    state, more = next_round(SearchState(start), progress, false_alarm_rate)
    if state.adopted:
        progress("asking when commands act")
        clock = likeliest_clock(start, state.best)
        if clock != start.clock:
            start = calibrate(campaign, pool, progress, clock=clock)
            return next_round(SearchState(start), progress, false_alarm_rate)
    return state, more


def next_round(state: SearchState, progress: Progress, false_alarm_rate: float) -> tuple[SearchState, bool]:
    """One round of the search; the state after it, and whether an effect was adopted."""
    bench, current = state.bench, state.best
    names = candidates.candidates(current.model, bench.channels())
    explored = candidates.explore(bench, current, names, progress)
    progress("scoring what chance gives")
    draws = chance.permutation_scores(bench, current, explored.slopes)
    by_chance, ranked = chance.threshold(draws, false_alarm_rate), explored.ranked
    if ranked and ranked[0].score > rules.MODEL_ERROR_SCORE:
        ranked = contest.fit_to_convergence(bench, current, ranked, progress)
        ranked = contest.prefer_closer_free_runs(bench, ranked)
        better = contest.better_calibration(bench, current, ranked[0])
        if better is not None:
            progress("looking again beside a better calibration")
            return next_round(state.with_last_fit(better), progress, false_alarm_rate)
    ranked, choice, confirmed = contest.confirm_in_fine_limit(bench, current, ranked, by_chance, state.gained)
    judgements = contest.judge_round(confirmed, current, ranked, by_chance, state.gained)
    threshold = max(by_chance, rules.MODEL_ERROR_SCORE, rules.MODEL_ERROR_SHARE * state.gained)
    done = Round(tuple(ranked), by_chance, threshold, draws, judgements)
    if choice is None:
        return state.with_round(done), False
    progress(f"adopting {choice.name}")
    bench, current = contest.refit_with_own_noise(confirmed, current, choice.fit)
    done = replace(done, adopted=replace(choice, fit=current), bench=bench)
    return revise.revise(state.with_round(done), progress), True


def on_sound_channels(state: SearchState) -> tuple[SearchState, Workbench]:
    """The state with its last fit made without sensors of the link that nothing explains, and the data of that fit.

    A fault of one sensor is no calibration: the parameters of the link would be fitted to it, and those of the hub with
    them. Where no sensor of the link is explained, the fault may be in the link. An effect of a sensor that it does not
    explain is withdrawn.
    """
    bench, best = state.bench, state.best
    link = bench.channels() - {"hub_angle", "motor_torque"}
    faulty = link & set(remainder.unexplained_channels(state))
    if state.adopted and _read_by(state.adopted[-1].name) & faulty:
        return on_sound_channels(_without_last(state))
    if not faulty or faulty == link or faulty & {u.channel for u in _parameters(best.model.effects)}:
        return state, bench
    sound = bench.without_channels(faulty)
    again = minimise(
        sound, best.model, best.starts, best.unknowns, best.values, iterations=contest.FULL_ITERATIONS
    )
    return state.with_last_fit(again), sound


def _without_last(state: SearchState) -> SearchState:
    """The state without the effect that was adopted last."""
    *kept, last = state.adopting
    undone = [last.without_adoption()] if state.last is not None else []
    return replace(state, rounds=(*kept, *undone))


def with_errors(state: SearchState, bench: Workbench) -> SearchState:
    """The state with covariances of its last fit, on these data, and of the calibration."""
    best = _with_covariance(bench, state.best)
    if state.adopted:
        calibrated = jackknife.with_jackknife_covariance(state.start.bench, state.base)
        state = replace(state, start=replace(state.start, base=calibrated))
    return state.with_last_fit(best)


def _with_covariance(bench: Workbench, best: Fit) -> Fit:
    """The fit taken to its minimum along directions in which it is hardly determined, with its covariance.

    Where only declarations tell the common scale of all inertias and stiffnesses, a search stops short of the minimum.
    """
    smooth, by_roughness = refine.jacobian_and_roughness(bench, best)
    if refine.predicted_gain(bench, smooth) > refine.MIN_GAIN:
        smooth, by_roughness = refine.jacobian_and_roughness(bench, refine.refined_fit(bench, smooth))
    sure = jackknife.with_jackknife_covariance(bench, smooth)
    return replace(sure, covariance=sure.covariance + by_roughness)


def _parameters(names: Iterable[str]) -> list[EffectParameter]:
    return [p for name in names for p in REGISTRY[name].parameters]


def _read_by(name: str) -> set[str | None]:
    """Channels of an effect that is one of sensors alone; empty for any other."""
    channels = {p.channel for p in _parameters([name])}
    return set() if None in channels else channels
