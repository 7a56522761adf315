"""Calibration: from recordings to the declared model with its parameters refitted within their uncertainty.

Defective readings are left out, the time at which commands act is determined, and the calibrated model defines the
filters and the noise of the data on which effects are searched for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from twin.estimation.minimise import FAR_ITERATIONS, minimise, with_own_jacobian
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.slopes import cost_of, costs_at, difference_jacobian, first_steps
from twin.estimation.unknowns import (
    Unknown,
    channel_unknowns,
    clock_unknown,
    declared_unknowns,
    known_effect_unknowns,
    model_and_starts_at,
    model_at,
    start_unknowns,
)
from twin.estimation.workbench import Workbench, driven_data
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.progress import Progress, silent
from twin.recording import CHANNEL_UNITS, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID
from twin.residuals.prepared import Prepared, prepare
from twin.residuals.significance import SIGNIFICANT
from twin.rigs.model import FixedStepModel, Model

SEARCH_SEGMENTS = 6
"""Segments of the search, whose integration step is that of the grid. Its discretisation error is removed, see
`chain_limit`. With the fourth mode, five change with the amplitude by an error that is larger by a third."""
_IMPOSSIBLE = 3.0  # times the acceleration that the largest torque gives the hub alone
_WIDE = 0.2  # relative standard deviation beyond which a declared value is only a rough starting value


@dataclass(frozen=True)
class Calibration:
    """The calibrated model and the data that it was fitted to.

    Attributes:
      declared: the model as declared, with the chain of the search.
      readings: the fit recordings, defective readings missing.
      sound: of each of these the longest stretch in which the motion of the hub can be followed; commands at their
        time stamps.
      bench: the data of the fit, made from `sound` on `clock`.
      base: the fit.
      clock: the clock on which commands are held.
      notes: what was left out of the recordings, or assumed of them.
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
        """The prepared recordings of the data."""
        return self.bench.prepared

    @property
    def data(self) -> DrivenData:
        """The data of the fit, in which the measured hub angle drives the link."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data


def calibrate(
    campaign: Campaign,
    pool: ResidualPool,
    progress: Progress = silent,
    initial_values: Mapping[str, float] = MappingProxyType({}),
    clock: Clock | None = None,
) -> Calibration:
    """Calibrates the declared model on the fit recordings.

    Args:
      campaign: the recordings; held-out ones are not read.
      pool: where residuals are computed.
      progress: called at the beginning of each stage.
      initial_values: parameter of the rig -> where the fit starts, if not at its declared value.
      clock: the clock on which commands are held; None for the one on which the model fits best.

    Raises:
      InputError: the declared link diverges under the measured motion of the hub in every recording.
    """
    noise, model = noise_levels(campaign), _declared_model(campaign)
    progress("reading the recordings")
    readings, odd = defects.without_defects(campaign.fit, campaign.sensors)
    sound, cuts = sound_stretches(readings, noise, model)
    progress("calibrating")
    # Some tenths of a millisecond matter more than many an effect does, but less than a calibration.
    given = _Given(campaign.effect_errors, initial_values)
    clocks = possible_clocks(sound) if clock is None else (clock,)
    options = [_rough_calibration(option, sound, noise, model, given, pool) for option in clocks]
    rough = min(options, key=lambda option: option.fit.cost)
    bench, base = _final_calibration(rough.bench, model, rough.fit)
    notes = (*odd, *cuts, *rough.notes)
    return Calibration(model, tuple(readings), tuple(sound), bench, base, rough.clock, notes)


def _declared_model(campaign: Campaign) -> Model:
    """The rig as it is declared, on the chain of a search."""
    shape = chain.fit_shape(campaign.rig, SEARCH_SEGMENTS)
    return FixedStepModel(campaign.rig, campaign.sensors, shape, campaign.effects, GRID)


def declared_fit(campaign: Campaign, pool: ResidualPool) -> tuple[Workbench, Fit]:
    """The data of the fit recordings and the declared model on them with its Jacobian, nothing fitted.

    Raises:
      InputError: the declared link diverges under the measured motion of the hub in every recording.
    """
    noise, model = noise_levels(campaign), _declared_model(campaign)
    readings, _ = defects.without_defects(campaign.fit, campaign.sensors)
    sound, _ = sound_stretches(readings, noise, model)
    clock = possible_clocks(sound)[0]
    data = driven_data([_prepare_on_clock(clock, r, noise, model)[0] for r in sound], model, pool)
    _divergence_notes(data)
    bench, starts = Workbench(data, pool), tuple(p.start for p in data.prepared)
    unknowns = _all_unknowns(model, bench, _Given(campaign.effect_errors, {}))
    x, steps = np.array([u.start for u in unknowns]), first_steps(unknowns)
    [r] = bench.residuals([(*model_and_starts_at(model, starts, unknowns, x), None)])
    J, _ = difference_jacobian(bench, model, starts, unknowns, x, r, steps, {})
    cost, unsure = cost_of(bench, unknowns, x, r), np.zeros((len(x), len(x)))
    return bench, Fit(model, starts, unknowns, x, unsure, r, bench.sizes(r), cost, J)


def likeliest_clock(start: Calibration, best: Fit) -> Clock:
    """The clock on which a model with effects fits best, which may differ from that of the calibration."""
    clocks = possible_clocks(start.sound)
    if len(clocks) == 1:
        return start.clock
    return min(clocks, key=lambda clock: _cost_on(clock, start, best))


def _cost_on(clock: Clock, start: Calibration, best: Fit) -> float:
    """Cost of the model of `best`, refitted to the recordings with commands held on this clock."""
    pairs = zip(start.sound, start.prepared, strict=True)
    prepared = [_prepare_on_clock(clock, recording, p.noise, best.model)[0] for recording, p in pairs]
    pool = start.bench.pool
    bench = Workbench(driven_data(prepared, best.model, pool), pool)
    bench, _ = chain_limit.without_discretisation_error(bench, best.model, best.starts, chain_limit.ROUGH)
    return minimise(bench, best.model, best.starts, best.unknowns, best.values).cost


def _prepare_on_clock(
    clock: Clock, recording: Recording, noise: Mapping[str, float], model: Model
) -> tuple[Prepared, list[str]]:
    """The prepared recording with commands held on a clock and its initial state, and what was left out of it."""
    prepared, left_out = prepare(with_command_clock(recording, clock), noise)
    return first_state.with_bend(prepared, model), left_out


@dataclass(frozen=True)
class _Given:
    """Prior knowledge: standard errors of declared effects (effect -> parameter), initial values of rig parameters."""

    effect_errors: Mapping[str, Mapping[str, float]]
    initial_values: Mapping[str, float]


@dataclass(frozen=True)
class _RoughCalibration:
    """A first calibration with commands held on one clock, and notes on its data."""

    clock: Clock
    bench: Workbench
    fit: Fit
    notes: tuple[str, ...]


def _rough_calibration(
    clock: Clock,
    recordings: Sequence[Recording],
    noise: Mapping[str, float],
    model: Model,
    given: _Given,
    pool: ResidualPool,
) -> _RoughCalibration:
    """Fits declared parameters, declared effects, command delay and initial states with a rough chain correction.

    Args:
      clock: on which commands are held.
      recordings: sound stretches.
      noise: channel -> standard deviation.
      model: the declared model.
      given: prior knowledge.
      pool: where residuals are computed.
    """
    pairs = [_prepare_on_clock(clock, recording, noise, model) for recording in recordings]
    data = driven_data([prepared for prepared, _ in pairs], model, pool)
    left_out = [note for _, notes in pairs for note in notes]
    notes = (*left_out, *clock_notes(clock), *_divergence_notes(data))
    bench, starts = Workbench(data, pool), tuple(p.start for p in data.prepared)
    unknowns = _all_unknowns(model, bench, given)
    bench, _ = chain_limit.without_discretisation_error(bench, model, starts, chain_limit.ROUGH)
    x = initial_point(bench, model, starts, unknowns, given.initial_values)
    if any(p.recording.start == "unknown" for p in data.prepared):
        # The bend of a moving link is estimated with its frequencies: those of the declared link may be far off.
        near = model_at(model, unknowns, x)
        bench = Workbench(driven_data(first_state.with_bends(data.prepared, near, pool), near, pool), pool)
        starts, unknowns = tuple(p.start for p in bench.prepared), _all_unknowns(model, bench, given)
        bench, _ = chain_limit.without_discretisation_error(bench, near, starts, chain_limit.ROUGH)
        nearer = {u.name: float(v) for u, v in zip(unknowns, x, strict=True) if u.kind == "rig"}
        x = initial_point(bench, model, starts, unknowns, nearer)
    fit = minimise(bench, model, starts, unknowns, x, iterations=FAR_ITERATIONS)
    return _RoughCalibration(clock, bench, fit, notes)


def _all_unknowns(model: Model, bench: Workbench, given: _Given) -> tuple[Unknown, ...]:
    """Unknowns of a calibration: declared parameters and effects, clock, errors of channels, initial states."""
    return (
        *declared_unknowns(model),
        *known_effect_unknowns(model, given.effect_errors, bench.channels()),
        clock_unknown(bench.prepared),
        *channel_unknowns(model, bench.channels()),
        *start_unknowns(bench.prepared),
    )


def _divergence_notes(data: DrivenData) -> list[str]:
    """Notes on recordings without residuals, most of all because the declared link diverges under the hub's motion.

    Raises:
      InputError: no recording has residuals.
    """
    used = {group.recording for group in data.groups}
    lost = {
        p.recording.name: v
        for i, (p, v) in enumerate(zip(data.prepared, data.views, strict=True))
        if i not in used
    }
    diverged = [name for name, view in lost.items() if not np.isfinite(list(view.noise.values())).all()]
    if diverged and not used:
        raise InputError(
            f"{', '.join(diverged)}: the declared link runs away under the measured motion of the hub; expected "
            "parameters and units with which it can be simulated"
        )
    if not used:
        raise InputError(
            f"{', '.join(lost)}: nothing to compare; expected readings of the hub angle, and a hub that moves or "
            "readings of a sensor on the link"
        )
    return [_lost_note(name, name in diverged) for name in lost]


def _lost_note(name: str, diverged: bool) -> str:
    """Why a recording says nothing."""
    begin = f"{name} could not be used to find anything: "
    if not diverged:
        return begin + "its hub has no readings, or rests while no sensor on the link has any."
    return (
        begin
        + "the declared link runs away under its motion of the hub. What it moves is far from what is declared, "
        "or it began in a motion too violent to be followed."
    )


def prepare_clean(
    recording: Recording, sensors: Mapping[str, Sensor], clock: Clock, noise: Mapping[str, float]
) -> tuple[Prepared, tuple[str, ...]]:
    """A whole recording prepared for comparison with a model, defective readings missing.

    Args:
      recording: as read.
      sensors: channel -> how it is measured.
      clock: on which commands are held.
      noise: channel -> standard deviation, see `noise_levels`.

    Returns:
      The prepared recording, and notes on what was left out.
    """
    [clean], odd = defects.without_defects([recording], sensors)
    prepared, left_out = prepare(with_command_clock(clean, clock), noise)
    return prepared, (*odd, *left_out)


def noise_levels(campaign: Campaign) -> dict[str, float]:
    """Channel -> standard deviation of its noise: declared, or the largest estimate from a fit recording."""
    levels = {}
    for name, sensor in campaign.sensors.items():
        estimates = [estimate_noise(r[name]) for r in campaign.fit if name in r]
        declared = sensor.noise
        levels[name] = declared if declared else max(estimates, default=0.0)
    return {name: value for name, value in levels.items() if value > 0 and name in CHANNEL_UNITS}


def sound_stretches(
    recordings: Sequence[Recording], noise: Mapping[str, float], model: Model
) -> tuple[list[Recording], list[str]]:
    """The longest stretch of each recording in which the motion of the hub can be followed, and notes on the rest."""
    kept, notes = [], []
    for recording in recordings:
        peak = np.nanmax(np.abs(recording["torque_command"])) + model.declared["static_friction"]
        strongest = _IMPOSSIBLE * peak / model.declared["hub_inertia"]
        cut, note = longest_valid_stretch(recording, noise.get("hub_angle", 0.0), float(strongest))
        kept.append(cut)
        notes += [note] if note else []
    return kept, notes


def _final_calibration(bench: Workbench, model: Model, rough: Fit) -> tuple[Workbench, Fit]:
    """Data whose noise and chain correction are those of a roughly calibrated model, and the fit to them."""
    bench = with_noise_of(bench, rough.model)
    bench = chain_limit.with_limit(bench, rough.model, rough.starts, chain_limit.STANDARD)
    fit = minimise(bench, model, rough.starts, rough.unknowns, rough.values, iterations=3)
    return bench, with_own_jacobian(bench, fit)


def with_noise_of(bench: Workbench, model: Model) -> Workbench:
    """The same recordings, their noise propagated through this model: the link rings at its clamped frequencies."""
    return Workbench(driven_data(bench.prepared, model, bench.pool), bench.pool)


def initial_point(
    bench: Workbench,
    model: Model,
    starts: Sequence[Start],
    unknowns: Sequence[Unknown],
    initial_values: Mapping[str, float],
) -> np.ndarray:
    """Values (p) from which the fit of a rig starts: `initial_values`, then declared values.

    A link whose frequencies are far off lies in another local minimum of the cost. Bending stiffness and damping ratio,
    where their declared uncertainty is large, are therefore set to the best point of a coarse grid first.
    """
    first = [initial_values.get(u.name, u.start) if u.kind == "rig" else u.start for u in unknowns]
    x = np.array([np.clip(value, *u.bounds) for value, u in zip(first, unknowns, strict=True)])
    for name in ("bending_stiffness", "damping_ratio", "bending_stiffness"):
        for index, u in enumerate(unknowns):
            if u.name == name and u.prior and u.scale > _WIDE * abs(u.start):
                spread = min(1.0, 2 * u.scale / abs(u.start))
                values = np.clip(x[index] * np.geomspace(1 / (1 + spread), 1 + spread, 11), *u.bounds)
                points = [np.r_[x[:index], value, x[index + 1 :]] for value in values]
                x = points[int(np.argmin(costs_at(bench, model, starts, unknowns, points)))]
    return x


def late_command_notes(fit: Fit) -> list[str]:
    """A note on the fitted delay of the commands against their time stamps, if it is significant."""
    for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True):
        if u.kind == "clock" and abs(value) > SIGNIFICANT * error:
            return [f"Commands are taken to act {1e3 * value:+.2f} ms off their time stamps."]
    return []
