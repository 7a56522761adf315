"""From recordings to the calibrated model: what is sound in them, when commands act, where parameters stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from twin.campaigns import defects
from twin.campaigns.campaign import Campaign
from twin.campaigns.clock import Clock, clock_notes, possible_clocks, with_command_clock
from twin.campaigns.readings import estimate_noise, longest_valid_stretch
from twin.errors import InputError
from twin.estimation import chain_limit, first_state
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.slopes import costs_at
from twin.estimation.unknowns import (
    Unknown,
    clock_unknown,
    declared_unknowns,
    known_effect_unknowns,
    start_unknowns,
)
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.progress import Progress, silent
from twin.recording import CHANNEL_UNITS, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, prepare
from twin.rigs.model import Model

SEARCH_SEGMENTS, SEARCH_STEP = 5, 2e-3
"""A coarse chain is enough to search on: its own error is taken out by `limit.move`."""
_IMPOSSIBLE = 3.0  # times the acceleration that the largest torque gives the hub alone


@dataclass(frozen=True)
class Calibration:
    """The declared model with its parameters moved within their uncertainty, and what it was moved on.

    Attributes:
      declared: the model as declared.
      readings: the fit recordings, without readings that are no measurements.
      sound: of these what can be followed, on no clock yet.
      bench: the same, made ready.
      base: the fit.
      clock: when commands act.
      notes: what was left out of the recordings or assumed of them.
    """

    declared: Model
    readings: tuple[Recording, ...]
    sound: tuple[Recording, ...]
    bench: Workbench
    base: Fit
    clock: Clock
    notes: tuple[str, ...]

    @property
    def prepared(self) -> tuple[Prepared, ...]:
        """The recordings."""
        return self.bench.prepared

    @property
    def data(self) -> DrivenData:
        """The recordings, the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data


def calibrate(
    campaign: Campaign,
    pool: ThreadPoolExecutor,
    progress: Progress = silent,
    told: Mapping[str, float] = MappingProxyType({}),
    clock: Clock | None = None,
) -> Calibration:
    """Calibrates the declared model on the fit recordings.

    Args:
      campaign: the recordings; held-out ones are not looked at.
      pool: threads for the simulations.
      progress: told of every stage.
      told: parameter of the rig -> where to begin, if not as declared.
      clock: when commands act; None for that on which the calibrated model fits best.
    """
    noise = noise_levels(campaign)
    shape = chain.fit_shape(campaign.rig, SEARCH_SEGMENTS)
    model = Model(campaign.rig, campaign.sensors, shape, campaign.effects, SEARCH_STEP)
    progress("reading the recordings")
    readings, odd = defects.without_defects(campaign.fit, campaign.sensors)
    sound, cuts = sound_stretches(readings, noise, model)
    progress("calibrating")
    # Some tenths of a millisecond decide more than many an effect does, but less than a calibration.
    known = _Known(campaign.effect_errors, told)
    clocks = possible_clocks(sound) if clock is None else (clock,)
    options = [_roughly(option, sound, noise, model, known, pool) for option in clocks]
    rough = min(options, key=lambda option: option.fit.cost)
    bench, base = _calibrated(rough.bench, model, rough.fit)
    notes = (*odd, *cuts, *rough.notes)
    return Calibration(model, tuple(readings), tuple(sound), bench, base, rough.clock, notes)


def likeliest_clock(start: Calibration, best: Fit) -> Clock:
    """The clock on which a model fits best; one that lacks an effect may have chosen another."""
    clocks = possible_clocks(start.sound)
    if len(clocks) == 1:
        return start.clock
    return min(clocks, key=lambda clock: _cost_on(clock, start, best))


def _cost_on(clock: Clock, start: Calibration, best: Fit) -> float:
    pairs = zip(start.sound, start.prepared, strict=True)
    prepared = [_prepared(clock, recording, p.noise, best.model)[0] for recording, p in pairs]
    bench = Workbench(DrivenData(prepared, best.model), start.bench.pool)
    bench, _ = chain_limit.corrected(bench, best.model, best.starts, chain_limit.ROUGH)
    return minimise(bench, best.model, best.starts, best.unknowns, best.values).cost


def _prepared(
    clock: Clock, recording: Recording, noise: Mapping[str, float], model: Model
) -> tuple[Prepared, list[str]]:
    """The recording made ready on a clock, its first state too, and what was left out of it."""
    prepared, left_out = prepare(with_command_clock(recording, clock), noise)
    return first_state.with_bend(prepared, model), left_out


@dataclass(frozen=True)
class _Known:
    """Standard errors of the effects that a rig has (effect -> name), and where its parameters begin."""

    errors: Mapping[str, Mapping[str, float]]
    told: Mapping[str, float]


@dataclass(frozen=True)
class _Rough:
    """A calibration on one clock, as it begins."""

    clock: Clock
    bench: Workbench
    fit: Fit
    notes: tuple[str, ...]


def _roughly(
    clock: Clock,
    recordings: Sequence[Recording],
    noise: Mapping[str, float],
    model: Model,
    known: _Known,
    pool: ThreadPoolExecutor,
) -> _Rough:
    """Moves declared parameters within their uncertainty, commands held on this clock; the chain is a rough one."""
    pairs = [_prepared(clock, recording, noise, model) for recording in recordings]
    data = DrivenData([prepared for prepared, _ in pairs], model)
    left_out = [note for _, notes in pairs for note in notes]
    notes = (*left_out, *clock_notes(clock), *_out_of_reach(data))
    bench, starts = Workbench(data, pool), tuple(p.start for p in data.prepared)
    unknowns = (
        *declared_unknowns(model),
        *known_effect_unknowns(model, known.errors, bench.channels()),
        clock_unknown(bench.prepared),
        *start_unknowns(bench.prepared),
    )
    bench, _ = chain_limit.corrected(bench, model, starts, chain_limit.ROUGH)
    x = roughly(bench, model, starts, unknowns, known.told)
    return _Rough(clock, bench, minimise(bench, model, starts, unknowns, x, iterations=20), notes)


def _out_of_reach(data: DrivenData) -> list[str]:
    """What is said of recordings in which the declared link runs away under the motion of the hub.

    Raises:
      InputError: these are all.
    """
    seen = {group.recording for group in data.groups}
    lost = [p.recording.name for i, p in enumerate(data.prepared) if i not in seen]
    if not seen:
        raise InputError(
            f"{', '.join(lost)}: the declared link runs away under the measured motion of the hub; expected parameters "
            "and units with which it can be simulated"
        )
    return [
        f"{name} could not be used to find anything: the declared link runs away under its motion of the hub. What it "
        "moves is far from what is declared, or it began in a motion too violent to be followed."
        for name in lost
    ]


def made_ready(
    recording: Recording, sensors: Mapping[str, Sensor], clock: Clock, noise: Mapping[str, float]
) -> tuple[Prepared, tuple[str, ...]]:
    """A whole recording as models are held beside it, and what was left out of it; `noise` as by `noise_levels`."""
    [clean], odd = defects.without_defects([recording], sensors)
    prepared, left_out = prepare(with_command_clock(clean, clock), noise)
    return prepared, (*odd, *left_out)


def noise_levels(campaign: Campaign) -> dict[str, float]:
    """Channel -> standard deviation of its noise: declared, or seen in the fit recordings."""
    found = {}
    for name, sensor in campaign.sensors.items():
        seen = [estimate_noise(r[name]) for r in campaign.fit if name in r]
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
        cut, note = longest_valid_stretch(recording, noise.get("hub_angle", 0.0), float(strongest))
        kept.append(cut)
        notes += [note] if note else []
    return kept, notes


def _calibrated(bench: Workbench, model: Model, rough: Fit) -> tuple[Workbench, Fit]:
    """The data as the calibrated model sees them, the chain's own error taken out, and the fit to them."""
    bench = seen_by(bench, rough.model)
    bench, _ = chain_limit.corrected(bench, rough.model, rough.starts, chain_limit.QUICK)
    return bench, minimise(bench, model, rough.starts, rough.unknowns, rough.values, iterations=3)


def seen_by(bench: Workbench, model: Model) -> Workbench:
    """The same data, their noise that of this model: it rings at its frequencies."""
    return Workbench(DrivenData(bench.prepared, model), bench.pool)


_ROUGH = 0.2  # relative uncertainty beyond which a declared value is only a rough start


def roughly(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    told: Mapping[str, float],
) -> np.ndarray:
    """Where the fit of a rig starts: as declared, or for a rig known only roughly, the best of a coarse grid.

    What is `told` of a parameter otherwise, by a test of its own, say, goes before its declaration.

    A link whose frequencies are far off is in another valley than the right one: stiffness and damping, where their
    uncertainty is large, are tried over their range first.
    """
    first = [told.get(u.name, u.start) if u.owner == "rig" else u.start for u in unknowns]
    x = np.array([np.clip(value, *u.bounds) for value, u in zip(first, unknowns, strict=True)])
    for name in ("bending_stiffness", "damping_ratio", "bending_stiffness"):
        for index, u in enumerate(unknowns):
            if u.name == name and u.prior and u.scale > _ROUGH * abs(u.start):
                spread = min(1.0, 2 * u.scale / abs(u.start))
                values = np.clip(x[index] * np.geomspace(1 / (1 + spread), 1 + spread, 11), *u.bounds)
                points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
                x = points[int(np.argmin(costs_at(bench, model, starts, unknowns, points)))]
    return x


_SURE = 3.0  # standard errors from which commands are said to act late


def late_command_notes(found: Fit) -> list[str]:
    """What a fit found of the instant within a sample at which commands act, where it is surely off its stamp."""
    for u, value, error in zip(found.unknowns, found.values, found.errors, strict=True):
        if u.owner == "clock" and abs(value) > _SURE * error:
            return [f"Commands are taken to act {1e3 * value:+.2f} ms off their time stamps."]
    return []
