"""Simulation of every recording by the declared, the calibrated and the final model, without measured feedback."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.diagnosis.answer import ChannelError, Prediction
from twin.diagnosis.state import SearchState
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.output_error import BREAK_AWAY_CHANGE
from twin.estimation.static_friction import FinalModels
from twin.recording import CHANNEL_UNITS, Recording
from twin.residuals.prepared import Prepared
from twin.residuals.residual import has_unknown_zero
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate


def predict(
    campaign: Campaign, state: SearchState, polished: FinalModels, pool: ThreadPoolExecutor
) -> dict[str, Prediction]:
    """File -> recording and its free-running simulations by the three models of `polished`."""
    noise = noise_levels(campaign)
    augmented = polished.augmented.model
    models = (polished.declared, polished.calibrated.model, augmented)
    predictions: dict[str, Prediction] = {}
    roles: tuple[tuple[Literal["fit", "holdout"], tuple[Recording, ...]], ...] = (
        ("fit", campaign.fit),
        ("holdout", campaign.holdout()),
    )
    for role, recordings in roles:
        for recording in recordings:
            prepared, left_out = prepare_clean(recording, campaign.sensors, state.start.clock, noise)
            before, calibrated, after, *nearby = free_runs(models, prepared, pool)
            runs = (before, calibrated, after)
            errors = {
                c: _error(prepared, c, runs, nearby, has_unknown_zero(augmented, prepared, c))
                for c in prepared.channels
            }
            predictions[recording.name] = Prediction(
                role, recording, before, calibrated, after, errors, left_out
            )
    return predictions


def free_runs(models: Sequence[Model], prepared: Prepared, pool: ThreadPoolExecutor) -> list[Recording]:
    """Simulations from the first samples and the command alone: one of each model, then two of the last model.

    These two have a break-away torque smaller and larger by `output_error.BREAK_AWAY_CHANGE`.
    """
    exact = [with_fine_chain(m) for m in models]
    starts = [first_state.first_state(m, prepared, pool) for m in models]
    for share in (1 - BREAK_AWAY_CHANGE, 1 + BREAK_AWAY_CHANGE):
        exact.append(exact[len(models) - 1].with_break_away(share))
        starts.append(starts[len(models) - 1])
    return list(
        pool.map(lambda pair: simulate(pair[0], prepared.recording, pair[1]), zip(exact, starts, strict=True))
    )


def about_zero(off: np.ndarray, has_zero: bool) -> np.ndarray:
    """A difference (m) about the zero of its sensor, which is that of the recording: the mean, if it is unknown."""
    return off - np.nanmean(off) if has_zero else off


def _error(
    prepared: Prepared, channel: str, runs: Sequence[Recording], nearby: Sequence[Recording], has_zero: bool
) -> ChannelError:
    measured = prepared.recording[channel]
    known = np.isfinite(measured)

    def rms(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.sqrt(np.mean(about_zero((a - b)[known], has_zero) ** 2)))

    before, calibrated, after = (rms(measured, run[channel]) for run in runs)
    reach = max(rms(runs[-1][channel], run[channel]) for run in nearby)
    return ChannelError(before, calibrated, after, prepared.noise[channel], CHANNEL_UNITS[channel], reach)
