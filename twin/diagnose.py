"""The loop: calibrate, look at what is left, find the effect that explains it, report on held-out recordings."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from twin import chain, driven, evidence, fit, observe, polish, search, verdict
from twin.campaign import Campaign
from twin.conclude import conclude
from twin.diagnosis import ChannelError, Diagnosis, Prediction
from twin.fit import Fit, Prepared, Workbench
from twin.model import Model, simulate
from twin.recording import CHANNEL_UNITS, Recording
from twin.search import Candidate, Progress, silent

SEARCH_SEGMENTS, SEARCH_STEP = 5, 2e-3
"""A coarse chain is enough to search on: its own error is taken out by `Workbench.refine`."""
MOST_EFFECTS = 3
_IMPOSSIBLE = 3.0  # times the acceleration that the largest torque gives the hub alone
_LONG = 12  # iterations of a fit that is to arrive
_NEARBY = 1e-3  # relative change of the break-away torque by which a prediction's reach is told
_CONTENDERS, _CLOSE = (
    3,
    0.3,
)  # candidates that are fitted to the end, and the share of the best score they need


_ABOUT = 0.02  # share of the best score within which a simpler candidate is preferred


@dataclass(frozen=True)
class Found:
    """What the search came to, before any held-out recording is looked at."""

    declared: Model
    prepared: tuple[Prepared, ...]
    data: driven.DrivenData
    bench: Workbench
    base: Fit
    adopted: tuple[Candidate, ...]
    rounds: tuple[tuple[Candidate, ...], ...]
    clock: str
    notes: tuple[str, ...]

    @property
    def best(self) -> Fit:
        """The fit of the model that stands at the end of the search."""
        return self.adopted[-1].fit if self.adopted else self.base


def diagnose(campaign: Campaign, progress: Progress = silent, workers: int | None = None) -> Diagnosis:
    """Finds what a campaign's model lacks.

    Args:
      campaign: the recordings; held-out ones are simulated once, at the end.
      progress: told of every stage.
      workers: number of threads; by default one a processor.
    """
    began = time.perf_counter()
    with threadpool_limits(1), ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        found = find(campaign, pool, progress)
        followed = not verdict.unexplained(found.bench, found.best)
        if followed:
            progress("fitting the whole recordings")
        polished = polish.polish(found.prepared, found.base, found.best, found.declared, pool, whole=followed)
        progress("simulating every recording")
        predictions = predict(campaign, found, polished, pool)
    return conclude(campaign, found, polished, predictions, time.perf_counter() - began)


# Recordings are simulated side by side: threads of linear algebra beside them double the time.
@threadpool_limits.wrap(limits=1)
def find(campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress = silent) -> Found:
    """Searches the fit recordings for effects that the model lacks."""
    noise = noises(campaign)
    model = Model(
        campaign.rig, campaign.sensors, chain.fit_shape(campaign.rig, SEARCH_SEGMENTS), step=SEARCH_STEP
    )
    progress("reading the recordings")
    sound, cuts = sound_stretches(campaign.fit, noise, model)
    clock, prepared, notes = on_best_clock(sound, noise, model, pool)
    notes = cuts + notes
    data = driven.DrivenData(prepared, model)
    bench = Workbench(data, pool)
    progress("calibrating")
    base = calibrated(bench, model)
    rounds: list[tuple[Candidate, ...]] = []
    adopted: list[Candidate] = []
    current = base
    while len(adopted) < MOST_EFFECTS:
        ranked = search.explore(bench, current, search.candidates(current.model, bench.channels()), progress)
        if verdict.worth_adopting(bench, current, ranked):
            ranked = settled(bench, current, ranked, progress)
        rounds.append(tuple(ranked))
        choice = verdict.worth_adopting(bench, current, ranked)
        if choice is None:
            break
        progress(f"adopting {choice.effects[-1]}")
        current = on_fine_chain(bench, choice.fit)
        adopted.append(replace(choice, fit=current))
    return Found(model, prepared, data, bench, base, tuple(adopted), tuple(rounds), clock, tuple(notes))


def noises(campaign: Campaign) -> dict[str, float]:
    """Channel -> standard deviation of its noise: declared, or seen in the fit recordings."""
    found = {}
    for name, sensor in campaign.sensors.items():
        seen = [observe.noise_of(r[name]) for r in campaign.fit if name in r]
        declared = sensor.noise
        found[name] = declared if declared else max(seen, default=0.0)
    return {name: value for name, value in found.items() if value > 0 and name in CHANNEL_UNITS}


def sound_stretches(
    recordings: Sequence[Recording], noise: Mapping[str, float], model: Model
) -> tuple[list[Recording], list[str]]:
    """The recordings without the stretches in which the hub's motion cannot be followed, and what was left out."""
    kept, notes = [], []
    for recording in recordings:
        peak = np.nanmax(np.abs(recording["torque_command"])) + model.declared["static_friction"]
        strongest = _IMPOSSIBLE * peak / model.declared["hub_inertia"]
        cut, note = observe.longest_sound_stretch(recording, noise.get("hub_angle", 0.0), float(strongest))
        kept.append(cut)
        notes += [note] if note else []
    return kept, notes


def on_best_clock(
    recordings: Sequence[Recording], noise: Mapping[str, float], model: Model, pool: ThreadPoolExecutor
) -> tuple[str, tuple[Prepared, ...], list[str]]:
    """Decides on which clock a jittered card put out its commands, by which one the declared model fits best."""
    options = {"stamped": [r.replace() for r in recordings]}
    if any(observe.clock(r.time) is not None for r in recordings):
        for name in ("mean", "earliest"):
            options[name] = [on_clock(r, name) for r in recordings]
    best, cost = "", np.inf
    kept: tuple[Prepared, ...] = ()
    notes: list[str] = []
    for name, candidates in options.items():
        pairs = [fit.prepare(r, noise) for r in candidates]
        prepared = tuple(p for p, _ in pairs)
        value = 0.0
        if len(options) > 1:
            bench = Workbench(driven.DrivenData(prepared, model), pool)
            [r] = bench.residuals([(model, [p.start for p in prepared], None)])
            value = float(bench.count @ evidence.loss(bench.sizes(r)))
        if value < cost:
            best, cost, kept = name, value, prepared
            notes = [note for _, said in pairs for note in said]
    if best != "stamped":
        notes.append(
            "Time stamps scatter about a uniform clock; commands are taken to be held on that clock."
        )
    return best, kept, notes


def on_clock(recording: Recording, name: str) -> Recording:
    """The recording with its commands held on the uniform clock about which its time stamps scatter."""
    ticks = observe.clock(recording.time)
    if name == "stamped" or ticks is None:
        return recording
    late = float(np.min(recording.time - ticks)) if name == "earliest" else 0.0
    return recording.replace(command_time=ticks + late)


def calibrated(bench: Workbench, model: Model) -> Fit:
    """Moves declared parameters within their uncertainty; the chain's own error is taken out on the way."""
    starts = tuple(p.start for p in bench.prepared)
    unknowns = (*fit.calibration(model), *fit.start_unknowns(bench.prepared))
    bench.refine(model, search.fine(model), starts)
    x = search.roughly(bench, model, starts, unknowns)
    first = fit.minimise(bench, model, starts, unknowns, x, iterations=20)
    bench.refine(first.model, search.fine(first.model), first.starts)
    return fit.minimise(bench, model, starts, unknowns, first.values, iterations=3)


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
    noise = noises(campaign)
    augmented = polished.augmented.model
    models = (polished.declared, polished.calibrated.model, augmented)
    found_all: dict[str, Prediction] = {}
    roles: tuple[tuple[Literal["fit", "holdout"], tuple[Recording, ...]], ...] = (
        ("fit", campaign.fit),
        ("holdout", campaign.holdout()),
    )
    for role, recordings in roles:
        for recording in recordings:
            prepared, _ = fit.prepare(on_clock(recording, found.clock), noise)
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
