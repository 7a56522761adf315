"""Simulation of every recording by the declared, the calibrated and the final model, without measured feedback."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.diagnosis import remainder
from twin.diagnosis.answer import MODELS, ChannelError, Prediction
from twin.diagnosis.error_budget import (
    ChannelBudget,
    ModelError,
    channel_budgets,
    model_errors,
    rms_error,
    zero_of,
)
from twin.diagnosis.state import SearchState
from twin.diagnosis.traces import held_out_torque
from twin.diagnosis.windows import simulate_windows
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.static_friction import FinalModels, with_static_levels
from twin.mechanics.state import Start
from twin.recording import CHANNEL_UNITS, Recording
from twin.residuals.prepared import Prepared
from twin.residuals.residual import has_unknown_zero
from twin.rigs.model import BREAK_AWAY_CHANGE, Model, with_fine_chain
from twin.rigs.simulate import simulate


@dataclass(frozen=True, eq=False)
class _Given:
    """A recording, and what its prediction takes.

    Attributes:
      prepared, left_out: the recording, and notes on what was left out of it.
      role: whether it was fitted or held out.
      models: the declared, the calibrated and the final one.
      between: the models after each adopted effect but the last.
      effects: names of the adopted effects.
      lacking: which of the models lack the torque that is shown; none for a recording that was fitted.
      has_budget: whether the recording evaluates the answer.
      has_windows: whether the final model is simulated in windows without a budget.
    """

    prepared: Prepared
    left_out: tuple[str, ...]
    role: Literal["fit", "holdout"]
    models: Sequence[Model]
    between: Sequence[Model]
    effects: Sequence[str]
    lacking: Sequence[int]
    has_budget: bool
    has_windows: bool


def predict(
    campaign: Campaign, state: SearchState, polished: FinalModels, pool: ResidualPool
) -> dict[str, Prediction]:
    """File -> recording and its free-running simulations by the three models of `polished`.

    Recordings that evaluate the answer, the held-out ones or, without any, all, get an error budget. Fitted ones beside
    held-out ones get the errors of the final model in windows where held-out ones can contradict it.
    """
    noise, held_out = noise_levels(campaign), campaign.holdout()
    models = (polished.declared, polished.calibrated.model, polished.augmented.model)
    between, unexplained = models_between(state), bool(remainder.unexplained_channels(state))
    lacking = (2,) if unexplained else (1, 2) if state.adopted else (1,)
    recordings, given = (*campaign.fit, *held_out), list[_Given]()
    for k, recording in enumerate(recordings):
        is_held_out = k >= len(campaign.fit)
        one = _Given(
            *prepare_clean(recording, campaign.sensors, state.start.clock, noise),
            "holdout" if is_held_out else "fit",
            models,
            between,
            state.names,
            lacking if is_held_out else (),
            has_budget=is_held_out or not held_out,
            has_windows=bool(held_out) and not unexplained,
        )
        given.append(one)
    longest = max(r.duration for r in recordings)
    # Those with a budget take longest.
    times = [r.duration + longest * one.has_budget for r, one in zip(recordings, given, strict=True)]
    done = pool.spread(_predicted, given, times)
    return {r.name: replace(one, measured=r) for r, one in zip(recordings, done, strict=True)}


def _predicted(given: _Given, pool: ResidualPool) -> Prediction:
    """The prediction of a recording."""
    prepared, models = given.prepared, given.models
    starts = first_states(models, prepared, pool)
    runs = free_runs(models, starts, prepared, pool)
    before, calibrated, after, *nearby = runs
    sooner = _with_sooner_commands(models[-1], starts[-1], prepared)
    with_zero = [c for c in prepared.channels if has_unknown_zero(models[-1], prepared, c)]
    errors = {
        c: channel_error(prepared, c, runs[:3], nearby, sooner, c in with_zero) for c in prepared.channels
    }
    zeros = {m: unknown_zeros(prepared, run, with_zero) for m, run in zip(MODELS, runs[:3], strict=True)}
    simulated = list(zip(models, starts, runs[:3], strict=True))
    budget, windows = dict[str, ChannelBudget](), dict[str, ModelError]()
    if given.has_budget:
        budget = error_budget(given.effects, simulated, given.between, prepared, pool)
        windows = {c: b.after for c, b in budget.items()}
    elif given.has_windows:
        windows = _errors(prepared, *simulated[-1])
    lacking = [(models[k], starts[k]) for k in given.lacking]
    torque = held_out_torque(models[1], lacking, prepared) if lacking else None
    return Prediction(
        given.role,
        prepared.recording,
        before,
        calibrated,
        after,
        errors,
        given.left_out,
        budget,
        windows,
        torque,
        zeros,
    )


def models_between(state: SearchState) -> list[Model]:
    """The models after each adopted effect but the last, their static friction levels found as by `FinalModels`."""
    return [with_static_levels(state.data, r.adopted.fit).model for r in state.adopting[:-1] if r.adopted]


def error_budget(
    effects: Sequence[str],
    simulated: Sequence[tuple[Model, Start, Recording]],
    between: Sequence[Model],
    prepared: Prepared,
    pool: ResidualPool,
) -> dict[str, ChannelBudget]:
    """Channel -> its error budget.

    Args:
      effects: names of the adopted effects.
      simulated: the declared, the calibrated and the final model, each with its state at the first sample and free run.
      between: the models after each effect but the last.
      prepared: the recording.
      pool: where the simulations run.
    """
    starts = first_states(between, prepared, pool)
    free = pool.map(lambda m, s: simulate(with_fine_chain(m), prepared.recording, s), between, starts)
    declared, calibrated, final = simulated
    stages = [declared, calibrated, *zip(between, starts, free, strict=True), *([final] if effects else [])]
    errors = pool.map(lambda stage: _errors(prepared, *stage), stages)
    return channel_budgets(prepared, effects, list(errors))


def _errors(prepared: Prepared, model: Model, start: Start, free: Recording) -> dict[str, ModelError]:
    """Channel -> error of a model; `start`: the state at the first sample, `free`: the free run."""
    return model_errors(prepared, model, free, simulate_windows(model, prepared, start, free))


def first_states(models: Sequence[Model], prepared: Prepared, pool: ResidualPool) -> list[Start]:
    """State of a recording at its first sample by each model."""
    return [first_state.first_state(m, prepared, pool) for m in models]


def free_runs(
    models: Sequence[Model], starts: Sequence[Start], prepared: Prepared, pool: ResidualPool
) -> list[Recording]:
    """Simulations from the states at the first sample and the command: one of each model, then two of the last model.

    These two have a break-away torque smaller and larger by `BREAK_AWAY_CHANGE`.
    """
    exact = [with_fine_chain(m) for m in models]
    nearby = [exact[-1].with_break_away(share) for share in (1 - BREAK_AWAY_CHANGE, 1 + BREAK_AWAY_CHANGE)]
    pairs = zip((*exact, *nearby), (*starts, starts[-1], starts[-1]), strict=True)
    return list(pool.map(lambda pair: simulate(pair[0], prepared.recording, pair[1]), pairs))


def _with_sooner_commands(model: Model, start: Start, prepared: Prepared) -> Recording | None:
    """A free run whose unknown commands are those behind their gap; None of a recording without missing rows."""
    other = prepared.recording.with_steps_before_gaps()
    return None if other is None else simulate(with_fine_chain(model), other, start)


def unknown_zeros(prepared: Prepared, run: Recording, channels: Sequence[str]) -> dict[str, float]:
    """Channel -> zero of its sensor beside a free run [SI]."""
    return {c: zero_of(prepared.recording[c] - run[c]) for c in channels}


def channel_error(
    prepared: Prepared,
    channel: str,
    runs: Sequence[Recording],
    nearby: Sequence[Recording],
    sooner: Recording | None,
    has_zero: bool,
) -> ChannelError:
    """Errors of a channel.

    Args:
      prepared: the recording.
      channel: measured and simulated.
      runs: free runs of the declared, the calibrated and the final model.
      nearby: free runs of the final model with other break-away torques.
      sooner: free run of the final model with other commands where rows are missing; None without missing rows.
      has_zero: whether the zero of its sensor is unknown.
    """
    measured = prepared.recording[channel]
    known = np.isfinite(measured)

    def rms(a: np.ndarray, b: np.ndarray) -> float:
        return rms_error((a - b)[known], has_zero)

    before, calibrated, after = (rms(measured, run[channel]) for run in runs)
    reach = max(rms(runs[-1][channel], run[channel]) for run in nearby)
    by_gaps = 0.0 if sooner is None else rms(runs[-1][channel], sooner[channel])
    noise, unit = prepared.noise[channel], CHANNEL_UNITS[channel]
    return ChannelError(before, calibrated, after, noise, unit, reach, by_gaps)
