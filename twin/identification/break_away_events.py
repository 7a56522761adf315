"""Break-away torque at the instants at which the measured hub leaves a rest.

The hub of the model is held while the measured one rests. The torque that friction has to hold just before the hub
moves is the static level in that direction and at that angle: no fit is needed, and no stick or slip of a simulation
matters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.campaigns.rests import SAMPLES_BEFORE_ONSET
from twin.mechanics import planar
from twin.mechanics.plant import IMMOVABLE
from twin.mechanics.state import Motion, Start
from twin.residuals.prepared import Prepared, guide_for
from twin.rigs.model import Model
from twin.rigs.simulate import integrate

_MAX_CHANGE = 0.02  # relative change of the torque over `_SPAN` up to which the instant is known well enough
_SPAN = 0.01  # s


@dataclass(frozen=True)
class BreakAway:
    """One break-away.

    Attributes:
      torque: that friction held just before, negative in negative direction [N m].
      direction: +1 or -1.
      angle: reading of the hub [rad].
      recording: index.
      time: instant [s].
      slope: rate at which the torque changed before [N m/s].
    """

    torque: float
    direction: int
    angle: float
    recording: int
    time: float
    slope: float


def find_break_aways(model: Model, prepared: Sequence[Prepared], starts: Sequence[Start]) -> list[BreakAway]:
    """Break-aways in the recordings whose torque is well defined."""
    return [
        event
        for i, (p, start) in enumerate(zip(prepared, starts, strict=True))
        if p.hub is not None
        for event in _in_recording(model, p, start, i)
    ]


def _with_held_hub(model: Model, prepared: Prepared, start: Start) -> Motion:
    """Motion of a model whose hub rests whenever the measured one does, under whatever torque."""
    # Friction that falls from the static level would hold the hub in motion too.
    firm = model.with_friction(static_positive=IMMOVABLE, static_negative=IMMOVABLE, stribeck_velocity=0.0)
    return integrate(firm, prepared.recording, start, guide_for(firm, prepared, tight=True))


def _in_recording(model: Model, prepared: Prepared, start: Start, index: int) -> list[BreakAway]:
    """Break-aways in one recording, the index of which is passed on."""
    motion = _with_held_hub(model, prepared, start)
    time = prepared.recording.time
    drive = model.read_torque(prepared.recording)
    needed = planar.holding_torque(model.plant_of(prepared.recording), time, *motion.state(), drive)
    period = prepared.recording.period
    lag = max(1, int(round(_SPAN / period)))
    events = []
    assert prepared.hub is not None
    for onset, direction in prepared.hub.onsets:
        k = onset - SAMPLES_BEFORE_ONSET
        if k < lag or motion.modes[k] != 0 or np.sign(needed[k]) != direction:
            continue
        if np.abs(needed[k] - needed[k - lag]) < _MAX_CHANGE * abs(needed[k]):
            angle = prepared.hub.reading[k]
            slope = abs(float(needed[k] - needed[k - lag]) / (lag * period))
            events.append(BreakAway(float(needed[k]), direction, float(angle), index, float(time[k]), slope))
    return events
