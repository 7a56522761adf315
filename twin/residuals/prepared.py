"""Recordings prepared for comparison with a model: no outliers, noise known, rests of the hub detected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.campaigns import rests
from twin.campaigns.readings import without_outliers
from twin.campaigns.rests import HubMotion
from twin.mechanics.planar import STUCK
from twin.mechanics.state import Guide, Start
from twin.recording import Recording
from twin.residuals.significance import CERTAIN
from twin.rigs.model import Model

MIN_READINGS = 4  # of a channel that is compared


@dataclass(frozen=True)
class Prepared:
    """A recording prepared for comparison with a model.

    Attributes:
      recording: outliers missing.
      noise: channel -> standard deviation of its noise.
      channels: channels that are compared.
      hub: rests and motion of the hub; None where its angle is not measured or it is clamped.
      start: state at the first sample by the readings, `hub_angle` as read by the sensor [rad].
      off_zero: channels whose readings before the hub first moves are not 0.
    """

    recording: Recording
    noise: Mapping[str, float]
    channels: tuple[str, ...]
    hub: HubMotion | None
    start: Start
    off_zero: frozenset[str] = frozenset()


def prepare(recording: Recording, noise: Mapping[str, float]) -> tuple[Prepared, list[str]]:
    """The prepared recording, and notes on the outliers that were left out; `noise`: channel -> deviation."""
    known = {name: noise[name] for name in recording.measured() if noise.get(name, 0.0) > 0}
    if recording.clamped:
        known.pop("hub_rate", None)
    clean, notes = without_outliers(recording, known)
    channels = tuple(c for c in known if np.isfinite(clean[c]).sum() >= MIN_READINGS)
    hub = None
    if "hub_angle" in channels and not clean.clamped:
        hub = rests.classify_hub_motion(clean, known["hub_angle"])
    start = Start(hub_angle=rests.first_reading(clean, hub))
    if clean.start == "unknown":
        start = rests.estimate_moving_start(clean)
    off_zero = frozenset() if hub is None else _off_zero(clean, known, channels, hub)
    return Prepared(clean, known, channels, hub, start, off_zero), notes


def _off_zero(
    recording: Recording, noise: Mapping[str, float], channels: Sequence[str], hub: HubMotion
) -> frozenset[str]:
    """Channels whose mean reading before the hub first moves is off by `CERTAIN` standard errors."""
    moving = np.flatnonzero(hub.observed != STUCK)
    before = slice(moving[0] if len(moving) else None)
    found = set()
    for channel in channels:
        readings = recording[channel][before]
        readings = readings[np.isfinite(readings)]
        error = noise[channel] / np.sqrt(max(len(readings), 1))
        if len(readings) and abs(float(readings.mean())) > CERTAIN * error:
            found.add(channel)
    return frozenset(found)


def shortest_period(prepared: Sequence[Prepared]) -> float:
    """Sample period of the fastest recording [s]."""
    return min(p.recording.period for p in prepared)


def guide_for(model: Model, prepared: Prepared, tight: bool) -> Guide | None:
    """The guide of a simulation, so that its hub rests and slides as the measured one does.

    Args:
      model: its sensor model turns readings into hub angles.
      prepared: the recording.
      tight: hold the hub until two samples before it visibly moves; otherwise a margin beside each rest is left free.

    Returns:
      None where the hub angle is not measured or the hub is clamped.
    """
    if prepared.hub is None:
        return None
    angle = model.hub_angle_of(prepared.hub.reading, prepared.recording.time)
    return rests.simulation_guide(prepared.hub, angle, tight)


def sensor_corrected_start(model: Model, prepared: Prepared, start: Start) -> Start:
    """The initial state of a rig at rest, its hub reading turned into the hub angle by the model's sensor.

    The state of a rig that was moving is fitted and remains as it is.
    """
    if prepared.recording.start != "rest" or "hub_angle" not in prepared.channels:
        return start
    angle = model.hub_angle_of(np.array([start.hub_angle]), prepared.recording.time[:1])
    return replace(start, hub_angle=float(angle[0]))
