"""How the identified rig predicts recordings that were held out, beside the declared one.

Free-running from the first samples and the command alone, a stick more or less decides the rest of a run; following,
the hub is held and released when the measured one rests and moves, so that the errors are those of link and slides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin import calibration, fit, search, timing
from twin.campaign import Campaign
from twin.fit import Prepared
from twin.identify.joint import Joint
from twin.model import Model, simulate
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
    """

    recording: str
    channel: str
    unit: str
    noise: float
    declared: float
    identified: float
    following: float


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
    rows = []
    for channel in prepared.channels:
        known = np.isfinite(recording[channel])
        off = [float(np.sqrt(np.mean((recording[channel] - r[channel])[known] ** 2))) for r in runs]
        rows.append(
            HeldOutError(recording.name, channel, CHANNEL_UNITS[channel], prepared.noise[channel], *off)
        )
    return rows
