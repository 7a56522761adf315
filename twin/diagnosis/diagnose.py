"""The loop: calibrate, look at what is left, find the effect that explains it, report on held-out recordings."""

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
    rather_named,
    remainder,
    revise,
    rules,
    stand_ins,
    unnamed,
    whole_orders,
)
from twin.diagnosis.answer import Diagnosis
from twin.diagnosis.conclude import conclude
from twin.diagnosis.plan import planned
from twin.diagnosis.state import SearchState
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
        found = search(campaign, pool, progress, false_alarm_rate)
        followed = not remainder.unexplained_channels(found)
        if followed:
            progress("reading the static friction")
        polished = static_friction.polish(
            found.data, found.base, found.best, found.start.declared, pool, whole=followed
        )
        progress("simulating every recording")
        predicted = predict.predict(campaign, found, polished, pool)
        pair = rules.closest_pair(found.rounds[: len(found.adopted)])
        plans = planned(campaign, pair, pool) if pair else []
        left = dependence.unexplained_residuals(found.bench, found.data, found.best)
        patched = None if followed else fit_patch.fit_patch(campaign, found, left, polished, predicted, pool)
    answer = conclude(campaign, found, left, polished, predicted, plans, patched)
    return replace(answer, false_alarm_rate=false_alarm_rate, wall_s=time.perf_counter() - began)


# Recordings are simulated side by side: threads of linear algebra beside them double the time.
@threadpool_limits.wrap(limits=1)
def search(
    campaign: Campaign,
    pool: ThreadPoolExecutor,
    progress: Progress = silent,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> SearchState:
    """Searches the fit recordings for effects that the model lacks."""
    found, more = first_round(campaign, pool, progress, false_alarm_rate)
    for _ in range(MOST_ROUNDS - 1):
        if not more or len(found.adopted) == MOST_EFFECTS:
            break
        found, more = next_round(found, progress, false_alarm_rate)
    progress("telling how sure it is")
    found, sound = on_sound_channels(found)
    found = with_errors(found, sound)
    progress("asking what has no name")
    other = stand_ins.without_stand_ins(found)
    if other is not None:
        other = with_unnamed(with_errors(other, other.bench), other.bench, false_alarm_rate)
        if remainder.unexplained_channels(other):
            return other
    found = with_unnamed(with_whole_orders(found, sound), sound, false_alarm_rate)
    named = rather_named.named_instead(found)
    if named is None:
        return found
    named = with_whole_orders(with_errors(named, named.bench), named.bench)
    named = with_unnamed(named, named.bench, false_alarm_rate)
    return found if remainder.unexplained_channels(named) else named


def with_unnamed(found: SearchState, sound: Workbench, false_alarm_rate: float) -> SearchState:
    """The same with what has no name, on these data."""
    return replace(found, nameless=unnamed.find_functions(sound, found.best, false_alarm_rate))


def with_whole_orders(found: SearchState, sound: Workbench) -> SearchState:
    """The same with orders at whole numbers where these data do not say otherwise."""
    best = whole_orders.with_whole_orders(sound, found.best)
    return found if best is found.best else with_last_fit(found, _sure(sound, best))


def first_round(
    campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress, false_alarm_rate: float
) -> tuple[SearchState, bool]:
    """The first round of the search, as by `next_round`: on the clock that what it adopts asks for."""
    start = calibrate(campaign, pool, progress)
    found, more = next_round(SearchState(start, (), (), (), (start.bench,)), progress, false_alarm_rate)
    if found.adopted:
        progress("asking when commands act")
        clock = likeliest_clock(start, found.best)
        if clock != start.clock:
            start = calibrate(campaign, pool, progress, clock=clock)
            return next_round(SearchState(start, (), (), (), (start.bench,)), progress, false_alarm_rate)
    return found, more


def next_round(found: SearchState, progress: Progress, false_alarm_rate: float) -> tuple[SearchState, bool]:
    """One round of the search: what was found with the effect that it adopts, if any, and whether there is one."""
    bench, current = found.bench, found.best
    explored = candidates.explore(
        bench, current, candidates.candidates(current.model, bench.channels()), progress
    )
    progress("scoring what chance gives")
    draws = chance.permutation_scores(bench, current, explored.slopes)
    by_chance = chance.threshold(draws, false_alarm_rate)
    least = max(by_chance, remainder.OWN_ERROR * sum(c.score for c in found.adopted))
    ranked = explored.ranked
    # The fits so far were quick ones: what may be worth adopting is settled before it is asked for that.
    if ranked and ranked[0].score > rules.LEAST_SCORE:
        ranked = contest.prefer_closer_free_runs(
            bench, contest.fit_to_convergence(bench, current, ranked, progress)
        )
        better = contest.better_calibration(bench, current, ranked[0])
        if better is not None:
            progress("looking again beside a better calibration")
            return next_round(with_last_fit(found, better), progress, false_alarm_rate)
    ranked, choice, confirmed = contest.confirm_in_fine_limit(bench, current, ranked, least)
    found = replace(
        found,
        rounds=(*found.rounds, tuple(ranked)),
        thresholds=(*found.thresholds, max(least, rules.LEAST_SCORE)),
        by_chance=(*found.by_chance, by_chance),
        draws=(*found.draws, draws),
    )
    if choice is None:
        return found, False
    progress(f"adopting {choice.effects[-1]}")
    bench, current = contest.refit_with_own_noise(confirmed, current, choice.fit)
    adopted = replace(choice, fit=current)
    found = replace(found, adopted=(*found.adopted, adopted), benches=(*found.benches, bench))
    return revise.revise(found, progress), True


def on_sound_channels(found: SearchState) -> tuple[SearchState, Workbench]:
    """The same, but its last fit made without the sensors of the link that nothing explains while others agree.

    With it the data that it was made on.

    A fault of one sensor is no calibration: the link's parameters would bend to it, and the hub's with them. Where no
    sensor of the link is explained, it may be the link. What an effect says of sensors that it does not explain is not
    what is missing.
    """
    bench, best = found.bench, found.best
    link = bench.channels() - {"hub_angle", "motor_torque"}
    faulty = link & set(remainder.unexplained_channels(found))
    if found.adopted and _read_by(found.adopted[-1].effects[-1]) & faulty:
        return on_sound_channels(replace(found, adopted=found.adopted[:-1], rounds=found.rounds[:-1]))
    if not faulty or faulty == link or faulty & {u.channel for u in _parameters(best.model.effects)}:
        return found, bench
    sound = bench.without(faulty)
    fit_again = minimise(
        sound, best.model, best.starts, best.unknowns, best.values, iterations=contest.FULL_ITERATIONS
    )
    return with_last_fit(found, fit_again), sound


def with_last_fit(found: SearchState, best: Fit) -> SearchState:
    """The same with another fit of the model that stands at its end."""
    if not found.adopted:
        return replace(found, start=replace(found.start, base=best))
    return replace(found, adopted=(*found.adopted[:-1], replace(found.adopted[-1], fit=best)))


def with_errors(found: SearchState, sound: Workbench) -> SearchState:
    """The same with honest errors of what was fitted last, on these data, and of the calibration."""
    best = _sure(sound, found.best)
    if found.adopted:
        calibrated = jackknife.sure(found.start.bench, found.base)
        found = replace(found, start=replace(found.start, base=calibrated))
    return with_last_fit(found, best)


def _sure(bench: Workbench, best: Fit) -> Fit:
    """The fit where its slopes along its ridge take it, and honest errors.

    Where nothing but declarations tells how large all inertias and stiffnesses are, a search creeps and stops short.
    """
    smooth, by_roughness = refine.looked_along(bench, best)
    if refine.promised(bench, smooth) > refine.WORTH:
        smooth, by_roughness = refine.looked_along(bench, refine.refined(bench, smooth))
    sure = jackknife.sure(bench, smooth)
    return replace(sure, covariance=sure.covariance + by_roughness)


def _parameters(names: Iterable[str]) -> list[EffectParameter]:
    return [p for name in names for p in REGISTRY[name].parameters]


def _read_by(name: str) -> set[str | None]:
    """Channels of an effect that is one of sensors alone; empty for any other."""
    channels = {p.channel for p in _parameters([name])}
    return set() if None in channels else channels
