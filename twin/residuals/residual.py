"""Residuals of a recording whose measured hub drives the modelled link: channels, hub torque, break-aways."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.stats import trim_mean

from twin.mechanics.state import Motion, Start
from twin.recording import HUB_TORQUE, Recording, Sensor
from twin.residuals import creep
from twin.residuals.filters import GRID, REACH, STRIDE, low_passed
from twin.residuals.hub_balance import (
    break_away_residual,
    delivered_torque,
    torque_reading,
    unmodelled_torque,
)
from twin.residuals.prepared import Prepared
from twin.residuals.view import NoiseModel, Signals, View, as_read, before_end, move_link, whitened
from twin.rigs.model import Model
from twin.rigs.simulate import sensor_readings

EVENT_CHANNELS = ("break_away", "departure")
"""Residuals at single instants, independent of one another; those of other channels are correlated by the filter."""


def residual(view: View, prepared: Prepared, model: Model, start: Start) -> dict[str, np.ndarray]:
    """Name -> residual (r) of the recording at its rows, see `normalise`; 0 where unknown."""
    raw = raw_residual(view, prepared, model, start)
    parts = {name: values for name, values in raw.items() if name not in view.measured}
    known = {name: _normalised_channel(view, name, raw[name]) for name in raw if name in view.measured}
    return {**known, **scaled(parts, view, model)}


def _normalised_channel(view: View, channel: str, values: np.ndarray) -> np.ndarray:
    """`normalise` of the raw residual (m) of a channel, which models of the same link share."""
    return view.normalised.get((channel, values), lambda: normalise(values, view, channel))


def scaled(residuals: dict[str, np.ndarray], noise: NoiseModel, model: Model) -> dict[str, np.ndarray]:
    """Raw residuals (m), normalised (r), the torque balance of the hub per unit of commanded torque.

    The command is known exactly. In newton metres, the balance would be the smaller, the smaller the rig and its torque
    gain are taken to be together.
    """
    parts = normalise_all(residuals, noise)
    if "hub_torque" in parts:
        parts["hub_torque"] = parts["hub_torque"] / model.torque_gain
    return parts


def scaled_change(view: View, model: Model, channel: str, change: np.ndarray) -> np.ndarray:
    """Change (..., r) of a residual by a low-passed change (..., m) of the raw one: scaled alike, 0 where unknown.

    That of the torque on the hub is at the instants of the motion, as that of the readings is at their own.
    """
    if channel == HUB_TORQUE:
        change = as_read(view.time, model.hub_late, change)
    known = view.sliding if channel == HUB_TORQUE else view.known[channel]
    return scaled({channel: known * change}, view, model)[channel]


def normalise_all(residuals: dict[str, np.ndarray], noise: NoiseModel) -> dict[str, np.ndarray]:
    """Name -> raw residual (m), see `normalise`."""
    return {name: normalise(values, noise, name) for name, values in residuals.items()}


def normalise(values: np.ndarray, noise: NoiseModel, name: str) -> np.ndarray:
    """A raw residual (..., m) at its rows (r) in multiples of the noise, the noise white and of equal size throughout.

    Strains and tip deflection pass a whitening filter. From every `filters.STRIDE`th value of them and of the hub
    torque the covariance of the link's ringing is removed, and they are divided by the local scale of the noise.
    Residuals at single instants (m) are normalised already, and rows are chosen from all of them.
    """
    if name in EVENT_CHANNELS:
        return values
    values = whitened(values, noise, name)[..., ::STRIDE]
    if name in noise.ringing:
        values = noise.ringing[name].whitened(values)
    return values / noise.noise_scale[name] if name in noise.noise_scale else values


def raw_residual(view: View, prepared: Prepared, model: Model, start: Start) -> dict[str, np.ndarray]:
    """Name -> measured minus simulated (m), 0 where unknown.

    Channels are in their own unit, low-passed. With a free hub there are also "hub_torque", see `continuous_residual`,
    and, in multiples of the noise, "break_away" and "departure": see `hub_balance.break_away_residual` and
    `creep.departure_residual`.
    """
    motion, required = move_link(view, prepared, model, start)
    if prepared.hub is None:
        return channel_residual(view, prepared, model, motion)
    delivered = delivered_torque(view, prepared, model)
    residuals = continuous_residual(view, prepared, model, motion, required, delivered)
    residuals["break_away"] = break_away_residual(view, model, motion, required, delivered)
    residuals["departure"], _ = creep.departure_residual(view.time, prepared, model, motion, view.departures)
    return residuals


def continuous_residual(
    signals: Signals,
    prepared: Prepared,
    model: Model,
    motion: Motion,
    required: np.ndarray,
    delivered: np.ndarray,
) -> dict[str, np.ndarray]:
    """Residuals (m) of the channels and, as "hub_torque", the unmodelled torque on a sliding hub [N m].

    Args:
      signals: the recording.
      prepared: the recording.
      model: to compare with.
      motion, required: see `move_link`.
      delivered: see `hub_balance.delivered_torque` (m) [N m].
    """
    residuals = channel_residual(signals, prepared, model, motion)
    torque = unmodelled_torque(signals, model, motion, required, delivered)
    shown = as_read(signals.time, model.hub_late, torque)
    residuals["hub_torque"] = np.where(signals.sliding & before_end(signals.time, REACH), shown, 0.0)
    return residuals


def channel_residual(
    signals: Signals, prepared: Prepared, model: Model, motion: Motion
) -> dict[str, np.ndarray]:
    """Channel -> measured minus simulated (m) in its unit, low-passed, 0 where unknown."""
    blank = Recording("", signals.time, {c: np.zeros(len(signals.time)) for c in signals.measured})
    strains = {c: v for c, v in blank.channels.items() if c != "motor_torque"}
    simulated = dict(sensor_readings(model, blank.replace(channels=strains), motion).channels)
    if "motor_torque" in signals.measured:
        simulated["motor_torque"] = torque_reading(signals, prepared, model)
    residuals = {}
    for channel in signals.measured:
        reading, has_zero = simulated[channel], has_unknown_zero(model, prepared, channel)
        off = partial(_off, signals, channel, reading, has_zero, prepared.hub is not None)
        residuals[channel] = signals.residuals.get((channel, has_zero, reading), off)
    return residuals


def _off(signals: Signals, channel: str, simulated: np.ndarray, has_zero: bool, free: bool) -> np.ndarray:
    """Measured minus simulated (m) of a channel, low-passed, 0 where unknown.

    Args:
      signals: the recording.
      channel: that is compared.
      simulated: its simulated values, not filtered (m).
      has_zero: whether its zero is estimated.
      free: whether the hub is free.
    """
    off = signals.measured[channel] - low_passed(simulated, GRID)
    if channel in signals.with_gaps:
        off += _gap_correction(signals, channel, simulated, free)
    if has_zero:
        off = without_zero(off, signals.known[channel])
    return np.where(signals.known[channel], off, 0.0)


def has_unknown_zero(model: Model, prepared: Prepared, channel: str) -> bool:
    """Whether the zero of a channel's sensor is a nuisance parameter of a recording.

    Of a link that is at rest before the hub first moves, the readings until then show whether the zero is off.
    """
    if not model.sensors.get(channel, Sensor(channel)).has_unknown_zero:
        return False
    return prepared.recording.start == "unknown" or channel in prepared.off_zero


def without_zero(off: np.ndarray, known: np.ndarray) -> np.ndarray:
    """A residual (m) less the zero of its sensor, estimated as the interquartile mean where there are readings.

    A median is as robust, but rough: each sample that passes it while the link rings otherwise moves it by another
    slope, and fits end beside their minimum.
    """
    return off - trim_mean(off[known], 1 / 4) if known.any() else off


def _gap_correction(signals: Signals, channel: str, simulated: np.ndarray, free: bool) -> np.ndarray:
    """Change of a low-passed strain (m) if its gaps are filled with simulated values, offset to their neighbours.

    The filter spreads what fills a gap to its sides. Filled with the simulation, a gap leaves no residual there.

    Args:
      signals: the recording.
      channel: the strain.
      simulated: its simulated values, not filtered (m).
      free: whether the hub is free: then the strain has passed the filter of the motion, too.
    """
    known, off = signals.known[channel], signals.with_gaps[channel] - simulated
    between = np.interp(signals.time, signals.time[known], off[known]) if known.any() else off
    change = low_passed(np.where(known, 0.0, between - off), GRID)
    return low_passed(change, GRID, signals.band) if free else change
