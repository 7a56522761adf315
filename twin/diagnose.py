"""The loop: calibrate, look at what is left, find the effect that explains it, report on held-out recordings."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from twin import calibration, chance, fit, patches, planning, polish, search, timing, verdict
from twin.calibration import Calibration
from twin.campaign import Campaign
from twin.conclude import conclude
from twin.diagnosis import ChannelError, Diagnosis, Prediction
from twin.effects import REGISTRY, EffectParameter
from twin.errors import InputError
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model, simulate
from twin.recording import CHANNEL_UNITS, MEASURED, Recording
from twin.search import Candidate, Progress, silent

MOST_EFFECTS = 3
FALSE_ALARM_RATE = 0.01
PLANNING_STEP = 1e-3  # s
_LONG = 12  # iterations of a fit that is to arrive
_NEARBY = 1e-3  # relative change of the break-away torque by which a prediction's reach is told
_CONTENDERS = 3  # candidates that are fitted to the end
_CLOSE = 0.3  # share of the best score that they need
_CLEARLY = 0.1  # by which the log of the errors of free runs has to differ
_ABOUT = 0.02  # share of the best score within which a simpler candidate is preferred


@dataclass(frozen=True)
class Found:
    """What the search came to, before any held-out recording is looked at.

    Attributes:
      start: the calibrated model from which the search started.
      adopted: candidates that were adopted, each on top of those before it.
      rounds: all candidates of each round, best first; the last one adopted nothing, unless the most were reached.
      thresholds: score that each round asked for.
    """

    start: Calibration
    adopted: tuple[Candidate, ...]
    rounds: tuple[tuple[Candidate, ...], ...]
    thresholds: tuple[float, ...]

    @property
    def bench(self) -> Workbench:
        """The data."""
        return self.start.bench

    @property
    def base(self) -> Fit:
        """The fit without any effect."""
        return self.start.base

    @property
    def best(self) -> Fit:
        """The fit of the model that stands at the end of the search."""
        return self.adopted[-1].fit if self.adopted else self.base


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
        found = find(campaign, pool, progress, false_alarm_rate)
        followed = not verdict.unexplained(found.bench, found.best)
        if followed:
            progress("fitting the whole recordings")
        polished = polish.polish(
            found.start.prepared, found.base, found.best, found.start.declared, pool, whole=followed
        )
        progress("simulating every recording")
        predictions = predict(campaign, found, polished, pool)
        pair = verdict.closest(found.rounds[: len(found.adopted)])
        plans = planned(campaign, pair, pool) if pair else []
        patched = None if followed else patches.patched(campaign, found, polished, predictions, pool)
    return conclude(campaign, found, polished, predictions, plans, patched, time.perf_counter() - began)


def planned(
    campaign: Campaign, pair: tuple[Candidate, Candidate], pool: ThreadPoolExecutor
) -> list[planning.Plan]:
    """Experiments that would tell two candidates apart, best first."""
    noise = {c: s for c, s in calibration.noises(campaign).items() if c in MEASURED}
    first, second = (c.fit.model.replace(step=PLANNING_STEP) for c in pair)
    return planning.plan(first, second, noise, pool)


# Recordings are simulated side by side: threads of linear algebra beside them double the time.
@threadpool_limits.wrap(limits=1)
def find(
    campaign: Campaign,
    pool: ThreadPoolExecutor,
    progress: Progress = silent,
    false_alarm_rate: float = FALSE_ALARM_RATE,
) -> Found:
    """Searches the fit recordings for effects that the model lacks."""
    start = calibration.calibrate(campaign, pool, progress)
    bench = start.bench
    rounds: list[tuple[Candidate, ...]] = []
    adopted: list[Candidate] = []
    thresholds: list[float] = []
    current = start.base
    while len(adopted) < MOST_EFFECTS:
        explored = search.explore(
            bench, current, search.candidates(current.model, bench.channels()), progress
        )
        progress("scoring what chance gives")
        by_chance = chance.threshold(chance.scores(bench, current, explored.slopes), false_alarm_rate)
        ranked = explored.ranked
        if verdict.worth_adopting(bench, current, ranked, by_chance):
            ranked = freely_decided(bench, settled(bench, current, ranked, progress))
        rounds.append(tuple(ranked))
        thresholds.append(max(by_chance, verdict.LEAST_SCORE))
        choice = verdict.worth_adopting(bench, current, ranked, by_chance)
        if choice is None:
            break
        progress(f"adopting {choice.effects[-1]}")
        current = on_fine_chain(bench, choice.fit)
        adopted.append(replace(choice, fit=current))
    return on_sound_channels(Found(start, tuple(adopted), tuple(rounds), tuple(thresholds)))


def on_sound_channels(found: Found) -> Found:
    """The same, but its last fit made without the sensors of the link that nothing explains while others agree.

    A fault of one sensor is no calibration: the link's parameters would bend to it, and the hub's with them. Where no
    sensor of the link is explained, it may be the link. What an effect says of sensors that it does not explain is not
    what is missing.
    """
    bench, best = found.bench, found.best
    link = bench.channels() - {"hub_angle", "motor_torque"}
    faulty = link & set(verdict.unexplained(bench, best))
    if found.adopted and _read_by(found.adopted[-1].effects[-1]) & faulty:
        return on_sound_channels(replace(found, adopted=found.adopted[:-1], rounds=found.rounds[:-1]))
    if not faulty or faulty == link or faulty & {u.channel for u in _parameters(best.model.effects)}:
        return found
    sound = bench.without(faulty)
    fit_again = fit.minimise(sound, best.model, best.starts, best.unknowns, best.values, iterations=_LONG)
    if not found.adopted:
        return replace(found, start=replace(found.start, base=fit_again))
    return replace(found, adopted=(*found.adopted[:-1], replace(found.adopted[-1], fit=fit_again)))


def _parameters(names: Iterable[str]) -> list[EffectParameter]:
    return [p for name in names for p in REGISTRY[name].parameters]


def _read_by(name: str) -> set[str | None]:
    """Channels of an effect that is one of sensors alone; empty for any other."""
    channels = {p.channel for p in _parameters([name])}
    return set() if None in channels else channels


def on_fine_chain(bench: Workbench, found: Fit) -> Fit:
    """The fit with the chain's own error taken out where it now stands: an effect may bend the link as never before."""
    bench.refine(found.model, search.fine(found.model), found.starts)
    return fit.minimise(bench, found.model, found.starts, found.unknowns, found.values, iterations=6)


def settled(
    bench: Workbench, base: Fit, ranked: Sequence[Candidate], progress: Progress = silent
) -> list[Candidate]:
    """The candidates, those that may be best fitted to the end."""
    best = ranked[0].score
    contenders = [c for c in ranked[:_CONTENDERS] if c.score > _CLOSE * best]
    progress(f"weighing {', '.join(c.effects[-1] for c in contenders)}")
    rest = [c for c in ranked if c not in contenders]
    return simplest_first([refined(bench, base, c) for c in contenders] + rest)


def simplest_first(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The candidates by score, but of those that are about as good as the best the one of fewest parameters first.

    What a model gets wrong itself grows with what there is to explain, and any parameter more can follow it.
    """
    ranked = sorted(candidates, key=lambda c: -c.score)
    alike = [c for c in ranked if c.score > ranked[0].score - max(5.0, _ABOUT * ranked[0].score)]
    simplest = min(alike, key=lambda c: len(c.fit.unknowns))
    return [simplest, *(c for c in ranked if c is not simplest)]


def freely_decided(bench: Workbench, ranked: list[Candidate]) -> list[Candidate]:
    """The candidates; of those that explain about as much, one whose free runs stay much closer first.

    Sticks and slips make a free run a poor judge of small differences; a clear one counts half of what decides.
    """
    alike = [c for c in ranked[:_CONTENDERS] if c.score > ranked[0].score - verdict.decisive(ranked[0].score)]
    if len(alike) < 2:
        return ranked
    free = Workbench(fit.FreeData(bench.prepared), bench.pool)
    cost = [free.cost(r) for r in free.residuals([(c.fit.model, c.fit.starts, None) for c in alike])]
    closest = alike[int(np.argmin(cost))]
    if cost[0] - min(cost) < _CLEARLY * free.count.sum():
        return ranked
    most = closest.score - 0.5 * verdict.decisive(ranked[0].score)
    rest = [replace(c, score=min(c.score, most)) for c in ranked if c is not closest]
    return [closest, *sorted(rest, key=lambda c: -c.score)]


def refined(bench: Workbench, base: Fit, candidate: Candidate) -> Candidate:
    """The candidate fitted with everything free.

    Without the effect the declared parameters had to stand in for it: the fit may as well start from these anew.
    """
    before = candidate.fit
    anew = np.array(
        [u.start if u.owner == "rig" else v for u, v in zip(before.unknowns, before.values, strict=True)]
    )
    # A group that fits badly weighs little, so that a fit can settle with it: both ways are gone to the end.
    results = [
        fit.minimise(bench, before.model, before.starts, before.unknowns, x, None, _LONG)
        for x in (before.values, anew)
    ]
    result = min(results, key=lambda r: r.cost)
    return Candidate(candidate.effects, result, search.gain(bench, base, result))


def predict(
    campaign: Campaign, found: Found, polished: polish.Polished, pool: ThreadPoolExecutor
) -> dict[str, Prediction]:
    """Every recording beside the declared, the calibrated and the augmented model, free-running."""
    noise = calibration.noises(campaign)
    augmented = polished.augmented.model
    models = (polished.declared, polished.calibrated.model, augmented)
    found_all: dict[str, Prediction] = {}
    roles: tuple[tuple[Literal["fit", "holdout"], tuple[Recording, ...]], ...] = (
        ("fit", campaign.fit),
        ("holdout", campaign.holdout()),
    )
    for role, recordings in roles:
        for recording in recordings:
            prepared, _ = fit.prepare(timing.on_clock(recording, found.start.clock), noise)
            before, calibrated, after, *nearby = free_runs(models, prepared, pool)
            runs = (before, calibrated, after)
            errors = {c: _error(prepared, c, runs, nearby, noise[c]) for c in prepared.channels}
            found_all[recording.name] = Prediction(role, recording, before, calibrated, after, errors)
    return found_all


def free_runs(models: Sequence[Model], prepared: Prepared, pool: ThreadPoolExecutor) -> list[Recording]:
    """The recording as each model predicts it from its first samples and its command alone.

    Behind these come two runs of the last model with its break-away torque changed a little.
    """
    exact = [search.fine(m) for m in models]
    starts = [fit.reading_start(m, prepared, prepared.start) for m in exact]
    if prepared.recording.start == "unknown":
        starts = [fit.estimated_start(m, prepared, pool) for m in models]
    plant = exact[-1].plant
    for share in (1 - _NEARBY, 1 + _NEARBY):
        levels = {name: share * getattr(plant, name) for name in ("static_positive", "static_negative")}
        exact.append(exact[len(models) - 1].with_plant(**levels))
        starts.append(starts[len(models) - 1])
    return list(
        pool.map(lambda pair: simulate(pair[0], prepared.recording, pair[1]), zip(exact, starts, strict=True))
    )


def _error(
    prepared: Prepared, channel: str, runs: Sequence[Recording], nearby: Sequence[Recording], noise: float
) -> ChannelError:
    measured = prepared.recording[channel]
    known = np.isfinite(measured)

    def rms(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.sqrt(np.mean((a - b)[known] ** 2)))

    before, calibrated, after = (rms(measured, run[channel]) for run in runs)
    reach = max(rms(runs[-1][channel], run[channel]) for run in nearby)
    return ChannelError(before, calibrated, after, noise, CHANNEL_UNITS[channel], reach)
