"""How the identified rig predicts recordings that were held out, beside the declared one.

Free-running from the first samples and the command alone, a stick more or less decides the rest of a run; following,
the hub is held and released when the measured one rests and moves, so that the errors are those of link and slides.
In windows, only what the hub's error changes by within a quarter of a second counts. By steps, the measured hub moves
the link at every instant and nothing adds up: what is left is in the link, the gauges or the torque of that instant.

A rig that was already moving at the first sample starts in the state that its first second tells.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin.campaigns.campaign import Campaign
from twin.estimation import first_state
from twin.estimation.calibrate import noise_levels, prepare_clean
from twin.estimation.minimise import minimise
from twin.estimation.unknowns import start_unknowns
from twin.estimation.workbench import Workbench, guided_residual
from twin.identification.joint import Joint
from twin.mechanics.state import Start
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, guide_for
from twin.rigs.model import Model, fine
from twin.rigs.simulate import simulate


@dataclass(frozen=True)
class HeldOutError:
    """Root-mean-square of measured minus simulated over one held-out recording, SI units.

    Attributes:
      recording, channel, unit: of what.
      noise: standard deviation of the sensor.
      declared, identified: free-running.
      following: of the identified rig, resting and moving as the measured hub did.
      windowed: as following, of the hub only what the error changes by within `fit.MEMORY`.
      by_steps: of the identified link under the measured hub; None for the hub itself.
      start: "rest", or "estimated" from the first second of a rig that was already moving.
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


def errors(
    campaign: Campaign, found: Joint, rig: Rig, pool: ThreadPoolExecutor
) -> tuple[tuple[HeldOutError, ...], list[str]]:
    """Errors on every held-out recording, and what they leave out; `rig` is the identified one."""
    noise = noise_levels(campaign)
    models = [found.fit.model.replace(declared=r) for r in (campaign.rig, rig)]
    rows: list[HeldOutError] = []
    notes: list[str] = []
    for recording in campaign.holdout():
        prepared, left_out = prepare_clean(recording, campaign.sensors, found.clock, noise)
        notes += left_out
        if prepared.channels:
            starts = [first_state.first_state(m, prepared, pool) for m in models]
            rows += _rows(prepared, [fine(m) for m in models], starts, pool)
    return tuple(rows), notes


def _rows(
    prepared: Prepared, models: Sequence[Model], starts: Sequence[Start], pool: ThreadPoolExecutor
) -> list[HeldOutError]:
    recording, (declared, identified), (before, start) = prepared.recording, models, starts
    guide = guide_for(identified, prepared, tight=False)
    runs = [
        simulate(declared, recording, before),
        simulate(identified, recording, start),
        simulate(identified, recording, start, guide),
    ]
    windows = guided_residual(identified, prepared, start)
    steps = _by_steps(prepared, identified, start, pool)
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


def _by_steps(prepared: Prepared, model: Model, start: Start, pool: ThreadPoolExecutor) -> dict[str, float]:
    """Channel of the link -> its error under the measured hub, behind the low-pass of `twin.residuals.data`."""
    data = DrivenData([prepared], model)
    view = data.views[0]
    if prepared.recording.start == "unknown" and data.groups:
        # Under a measured hub the link rings on for long: its first state is that of all the recording.
        bench = Workbench(data, pool)
        start = minimise(bench, model, [start], start_unknowns([prepared]), iterations=6).starts[0]
    found = residual.raw_residual(view, prepared, model, start)
    of_link = [g for g in data.groups if g.channel in view.measured and g.channel != "motor_torque"]
    return {g.channel: _rms(found[g.channel][data.weight[g.rows] > 0]) for g in of_link}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
