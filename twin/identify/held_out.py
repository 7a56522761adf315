"""How the identified rig predicts recordings that were held out, beside the declared one.

Free-running from the first samples and the command alone, a stick more or less decides the rest of a run; following,
the hub is held and released when the measured one rests and moves, so that the errors are those of link and slides.
In windows, only what the hub's error changes by within a quarter of a second counts. By steps, the measured hub moves
the link at every instant and nothing adds up: what is left is in the link, the gauges or the torque of that instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin import calibration, driven_residual, fit, search, timing
from twin.campaign import Campaign
from twin.fit import Prepared
from twin.identify.joint import Joint
from twin.look import look
from twin.model import Model, Start, simulate
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS


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


def errors(campaign: Campaign, found: Joint, rig: Rig) -> tuple[HeldOutError, ...]:
    """Errors on every held-out recording that starts at rest; `rig` is the identified one."""
    noise = calibration.noises(campaign)
    declared = search.fine(found.fit.model.replace(declared=campaign.rig))
    identified = declared.replace(declared=rig)
    rows = []
    for recording in campaign.holdout():
        if recording.start == "rest":
            prepared, _ = fit.prepare(timing.on_clock(recording, found.clock), noise)
            rows += _rows(prepared, declared, identified)
    return tuple(rows)


def _rows(prepared: Prepared, declared: Model, identified: Model) -> list[HeldOutError]:
    recording = prepared.recording
    start = fit.reading_start(identified, prepared, prepared.start)
    guide = fit.guided(identified, prepared, tight=False)
    runs = [
        simulate(declared, recording, start),
        simulate(identified, recording, start),
        simulate(identified, recording, start, guide),
    ]
    windows = fit.whitened(identified, prepared, start)
    steps = _by_steps(prepared, identified, start)
    rows = []
    for channel in prepared.channels:
        known = np.isfinite(recording[channel])
        free, better, following = (_rms((recording[channel] - r[channel])[known]) for r in runs)
        noise, unit = prepared.noise[channel], CHANNEL_UNITS[channel]
        windowed = noise * _rms(windows[channel][known])
        by_steps = steps.get(channel)
        rows.append(
            HeldOutError(recording.name, channel, unit, noise, free, better, following, windowed, by_steps)
        )
    return rows


def _by_steps(prepared: Prepared, model: Model, start: Start) -> dict[str, float]:
    """Channel of the link -> its error under the measured hub, behind the low-pass of `twin.driven`."""
    view = look(prepared, model)
    found = driven_residual.missing(view, prepared, model, start)
    return {c: _rms(found[c][view.known[c]]) for c in view.measured if c != "motor_torque"}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
