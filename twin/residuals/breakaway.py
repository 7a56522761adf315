"""Break-away torque, read at the instants at which the measured hub leaves a rest.

The hub of the model is held until the measurement moves; the torque that friction bore just before is the static
level there, in that direction and at that angle. No fit is needed, and no stick or slip of a simulation decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.campaigns.rests import SAMPLES_BEFORE_ONSET
from twin.mechanics import planar
from twin.mechanics.plant import IMMOVABLE
from twin.mechanics.state import Motion, Start
from twin.residuals.prepared import Prepared, guided
from twin.rigs.model import Model
from twin.rigs.simulate import integrate

_SLOW = 0.02  # relative change of the torque over `_SPAN` up to which the instant of the break-away is sure enough
_SPAN = 0.01  # s


@dataclass(frozen=True)
class BreakAway:
    """One break-away: torque [N m], direction, hub reading [rad], recording, instant [s], growth before it [N m/s]."""

    torque: float
    direction: int
    angle: float
    recording: int
    time: float
    slope: float


def find(model: Model, prepared: Sequence[Prepared], starts: Sequence[Start]) -> list[BreakAway]:
    """Break-aways in the recordings whose torque is well defined."""
    return [
        event
        for i, (p, start) in enumerate(zip(prepared, starts, strict=True))
        if p.hub is not None
        for event in _in_recording(model, p, start, i)
    ]


def levels(events: Sequence[BreakAway]) -> dict[int, float]:
    """Break-away torque by direction, +1 and -1, at the slowest approach; a direction never seen is left out [N m].

    The slower the torque grows, the less the instant of the break-away matters.
    """
    by_direction = {d: [e for e in events if e.direction == d] for d in (1, -1)}
    return {d: abs(min(seen, key=lambda e: e.slope).torque) for d, seen in by_direction.items() if seen}


def _held(model: Model, prepared: Prepared, start: Start) -> Motion:
    """A recording simulated with a hub that rests whenever the measured one does, whatever it takes to hold it."""
    # A friction that falls from the static level would hold it in motion too.
    firm = model.with_friction(static_positive=IMMOVABLE, static_negative=IMMOVABLE, stribeck_velocity=0.0)
    return integrate(firm, prepared.recording, start, guided(firm, prepared, tight=True))


def _in_recording(model: Model, prepared: Prepared, start: Start, index: int) -> list[BreakAway]:
    motion = _held(model, prepared, start)
    time = prepared.recording.time
    drive = model.read_torque(prepared.recording)
    needed = planar.holding_torque(model.plant_of(prepared.recording), time, *motion.state(), drive)
    period = prepared.recording.period
    lag = max(1, int(round(_SPAN / period)))
    found = []
    assert prepared.hub is not None
    for onset, direction in prepared.hub.onsets:
        k = onset - SAMPLES_BEFORE_ONSET
        if k < lag or motion.modes[k] != 0 or np.sign(needed[k]) != direction:
            continue
        if np.abs(needed[k] - needed[k - lag]) < _SLOW * abs(needed[k]):
            angle = prepared.hub.reading[k]
            slope = abs(float(needed[k] - needed[k - lag]) / (lag * period))
            found.append(BreakAway(float(needed[k]), direction, float(angle), index, float(time[k]), slope))
    return found
