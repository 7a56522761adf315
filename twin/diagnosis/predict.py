"""Every recording beside the models of a report, running freely."""

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
from twin.estimation.static_friction import FinalModels
from twin.recording import CHANNEL_UNITS, Recording
from twin.residuals.prepared import Prepared
from twin.rigs.model import Model, fine
from twin.rigs.simulate import simulate

_NEARBY = 1e-3  # relative change of the break-away torque by which a prediction's reach is told


def predict(
    campaign: Campaign, found: SearchState, polished: FinalModels, pool: ThreadPoolExecutor
) -> dict[str, Prediction]:
    """Every recording beside the declared, the calibrated and the augmented model, free-running."""
    noise = noise_levels(campaign)
    augmented = polished.augmented.model
    models = (polished.declared, polished.calibrated.model, augmented)
    found_all: dict[str, Prediction] = {}
    roles: tuple[tuple[Literal["fit", "holdout"], tuple[Recording, ...]], ...] = (
        ("fit", campaign.fit),
        ("holdout", campaign.holdout()),
    )
    for role, recordings in roles:
        for recording in recordings:
            prepared, left_out = prepare_clean(recording, campaign.sensors, found.start.clock, noise)
            before, calibrated, after, *nearby = free_runs(models, prepared, pool)
            runs = (before, calibrated, after)
            errors = {c: _error(prepared, c, runs, nearby) for c in prepared.channels}
            found_all[recording.name] = Prediction(
                role, recording, before, calibrated, after, errors, left_out
            )
    return found_all


def free_runs(models: Sequence[Model], prepared: Prepared, pool: ThreadPoolExecutor) -> list[Recording]:
    """The recording as each model predicts it from its first samples and its command alone.

    Behind these come two runs of the last model with its break-away torque changed a little.
    """
    exact = [fine(m) for m in models]
    starts = [first_state.first_state(m, prepared, pool) for m in models]
    for share in (1 - _NEARBY, 1 + _NEARBY):
        exact.append(exact[len(models) - 1].with_break_away(share))
        starts.append(starts[len(models) - 1])
    return list(
        pool.map(lambda pair: simulate(pair[0], prepared.recording, pair[1]), zip(exact, starts, strict=True))
    )


def _error(
    prepared: Prepared, channel: str, runs: Sequence[Recording], nearby: Sequence[Recording]
) -> ChannelError:
    measured = prepared.recording[channel]
    known = np.isfinite(measured)

    def rms(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.sqrt(np.mean((a - b)[known] ** 2)))

    before, calibrated, after = (rms(measured, run[channel]) for run in runs)
    reach = max(rms(runs[-1][channel], run[channel]) for run in nearby)
    return ChannelError(before, calibrated, after, prepared.noise[channel], CHANNEL_UNITS[channel], reach)
