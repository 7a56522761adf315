"""Prediction errors of the declared and the identified rig on held-out recordings.

Four simulations with growing use of the measurement:

- free-running: from the first samples and the command alone; one different stick changes the rest of the run.
- following: the hub is held and released when the measured one rests and moves; errors are those of link and sliding.
- windowed: as following, but of the hub's error only its change within a quarter of a second counts.
- by steps: the measured hub drives the link, so that errors do not accumulate; they are of link, gauges or torque.

A rig that is in motion at the first sample starts in a state that is estimated from its first second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import start_unknowns
from twin.estimation.workbench import Workbench, guided_residual
from twin.identification.joint import JointEstimate
from twin.mechanics.state import Start
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, guide_for
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate


@dataclass(frozen=True)
class HeldOutError:
    """Root-mean-square of measured minus simulated over one channel of a held-out recording, SI units.

    Attributes:
      recording, channel, unit: what is predicted.
      noise: standard deviation of the sensor noise.
      declared, identified: free-running, with the declared and the identified rig.
      following: identified rig, its hub at rest and in motion when the measured one is.
      windowed: as following; of the hub angle only the change of the error within `workbench.CHANGE_SPAN`.
      by_steps: identified link driven by the measured hub; None for the hub itself.
      start: "rest", or "estimated" for a rig that is in motion at the first sample.
    """

    recording: str
    channel: str
    unit: str
    noise: float
    declared: float
    identified: float
    following: float
    windowed: float
    by_steps: float | None
    start: Literal["rest", "estimated"] = "rest"


def held_out_errors(
    campaign: Campaign, joint: JointEstimate, rig: Rig, pool: ResidualPool
) -> tuple[tuple[HeldOutError, ...], list[str]]:
    """Returns the errors on every held-out recording, and notes on data that were left out.

    Args:
      campaign: with held-out recordings and the declared rig.
      joint: joint estimate with model and clock.
      rig: as identified.
      pool: where residuals are computed.
    """
    noise = noise_levels(campaign)
    models = [joint.fit.model.replace(declared=r) for r in (campaign.rig, rig)]
    rows: list[HeldOutError] = []
    notes: list[str] = []
    for recording in campaign.holdout():
        prepared, left_out = prepare_clean(recording, campaign.sensors, joint.clock, noise)
        notes += left_out
        if prepared.channels:
            starts = [first_state.first_state(m, prepared, pool) for m in models]
            rows += _errors_of_recording(prepared, [with_fine_chain(m) for m in models], starts, pool)
    return tuple(rows), notes


def _errors_of_recording(
    prepared: Prepared, models: Sequence[Model], starts: Sequence[Start], pool: ResidualPool
) -> list[HeldOutError]:
    """Errors of each channel of one recording, with the declared and the identified model and their initial states."""
    recording, (declared, identified), (before, start) = prepared.recording, models, starts
    guide = guide_for(identified, prepared, tight=False)
    runs = [
        simulate(declared, recording, before),
        simulate(identified, recording, start),
        simulate(identified, recording, start, guide),
    ]
    windows = guided_residual(identified, prepared, start)
    steps = _driven_link_errors(prepared, identified, start, pool)
    known_from: Literal["rest", "estimated"] = "estimated" if recording.start == "unknown" else "rest"
    rows = []
    for channel in prepared.channels:
        known = np.isfinite(recording[channel])
        free, better, following = (_rms((recording[channel] - r[channel])[known]) for r in runs)
        noise, unit = prepared.noise[channel], CHANNEL_UNITS[channel]
        windowed = noise * _rms(windows[channel][known])
        by_steps = steps.get(channel)
        rows.append(
            HeldOutError(
                recording.name, channel, unit, noise, free, better, following, windowed, by_steps, known_from
            )
        )
    return rows


def _driven_link_errors(
    prepared: Prepared, model: Model, start: Start, pool: ResidualPool
) -> dict[str, float]:
    """Channel of the link -> RMS error with the hub driven as measured, after the low-pass of `twin.residuals.data`."""
    data = DrivenData.of([prepared], model)
    view = data.views[0]
    if prepared.recording.start == "unknown" and data.groups:
        # The driven link oscillates for long: its initial state is fitted to the whole recording.
        bench = Workbench(data, pool)
        start = minimise(bench, model, [start], start_unknowns([prepared])).starts[0]
    missing = residual.raw_residual(view, prepared, model, start)
    of_link = [g for g in data.groups if g.channel in view.measured and g.channel != "motor_torque"]
    return {g.channel: _rms(missing[g.channel][g.instants[data.weight[g.rows] > 0]]) for g in of_link}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
