"""A recording made ready to be compared with: outliers out, noise known, rests of the hub found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.campaigns import rests
from twin.campaigns.readings import without_outliers
from twin.campaigns.rests import HubMotion
from twin.mechanics.state import Guide, Start
from twin.recording import Recording
from twin.rigs.model import Model

_FEWEST = 4  # readings that make a channel


@dataclass(frozen=True)
class Prepared:
    """A recording made ready to be compared with.

    Attributes:
      recording: without outliers.
      noise: channel -> standard deviation of its noise.
      channels: channels that are compared.
      hub: rests and motion of the hub, where it is measured and free.
      start: state at the first sample, by the readings.
    """

    recording: Recording
    noise: Mapping[str, float]
    channels: tuple[str, ...]
    hub: HubMotion | None
    start: Start


def prepare(recording: Recording, noise: Mapping[str, float]) -> tuple[Prepared, list[str]]:
    """Returns the recording made ready, and what was left out of it."""
    known = {name: noise[name] for name in recording.measured() if noise.get(name, 0.0) > 0}
    clean, notes = without_outliers(recording, known)
    channels = tuple(c for c in known if np.isfinite(clean[c]).sum() >= _FEWEST)
    hub = None
    if "hub_angle" in channels and not clean.clamped:
        hub = rests.classify_hub_motion(clean, known["hub_angle"])
    start = Start(hub_angle=rests.first_reading(clean, hub))
    if clean.start == "unknown":
        start = rests.estimate_moving_start(clean)
    return Prepared(clean, known, channels, hub, start), notes


def shortest_period(prepared: Sequence[Prepared]) -> float:
    """Sample period of the fastest recording [s]."""
    return min(p.recording.period for p in prepared)


def guided(model: Model, prepared: Prepared, tight: bool) -> Guide | None:
    """The guide of a recording under this model's hub sensor; `tight`: rests end where the measured ones do."""
    if prepared.hub is None:
        return None
    angle = model.hub_angle_of(prepared.hub.reading, prepared.recording.time)
    return rests.simulation_guide(prepared.hub, angle, tight)


def reading_start(model: Model, prepared: Prepared, start: Start) -> Start:
    """The state at the first sample, the hub's reading turned into its angle by the model of the sensor."""
    if prepared.recording.start != "rest" or prepared.hub is None:
        return start
    angle = model.hub_angle_of(np.array([start.hub_angle]), prepared.recording.time[:1])
    return replace(start, hub_angle=float(angle[0]))
