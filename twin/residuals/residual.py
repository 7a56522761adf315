"""What is left of a recording where its hub moves the model, in noise units."""

from __future__ import annotations

import numpy as np

from twin.mechanics.state import Start
from twin.recording import Recording
from twin.residuals import creep
from twin.residuals.filters import GRID, low_passed
from twin.residuals.hub_balance import break_aways, delivered, read_torque, unmodelled
from twin.residuals.prepared import Prepared
from twin.residuals.view import LEFT_OUT, View, before_end, move, whitened
from twin.rigs.model import Model
from twin.rigs.simulate import sensor_readings


def residual(view: View, prepared: Prepared, model: Model, start: Start) -> dict[str, np.ndarray]:
    """Name -> (m) what is `missing`, as `white`.

    The balance of the hub stands in the unit of the command, which is known exactly: in newton metres, it would be the
    smaller the smaller the rig and all that drives it were taken to be.
    """
    parts = white(missing(view, prepared, model, start), view)
    if "hub_torque" in parts:
        parts["hub_torque"] = parts["hub_torque"] / model.torque_gain
    return parts


def white(left: dict[str, np.ndarray], view: View) -> dict[str, np.ndarray]:
    """What is `missing` (m) in noise units, noise as large at every frequency and everywhere."""
    return {name: white_of(values, view, name) for name, values in left.items()}


def white_of(values: np.ndarray, view: View, name: str) -> np.ndarray:
    """What is `missing` (..., m) under one name in noise units.

    Strains pass the filter of `whitened`, both strains and torque their `ringing`, and stretches in which the noise
    swells become as quiet as the others.
    """
    if name in view.measured:
        values = whitened(values, view, name)
    elif name in view.noise:
        values = values / view.noise[name]
    if name in view.ringing:
        values = view.ringing[name].whitened(values)
    return values / view.swell[name] if name in view.swell else values


def missing(view: View, prepared: Prepared, model: Model, start: Start) -> dict[str, np.ndarray]:
    """Name -> (m) measured minus simulated in the channel's unit, 0 where unknown.

    `hub_torque` is the unmodelled torque on the hub [N m]; what is read at instants is in noise units.
    """
    motion, required = move(view, prepared, model, start)
    asked = Recording("", view.time, {c: np.zeros(len(view.time)) for c in view.measured})
    parts = {}
    simulated = sensor_readings(model, asked.replace(channels=_strains_only(asked)), motion)
    for channel, values in view.measured.items():
        if channel == "motor_torque":
            predicted = read_torque(view, prepared, model)
        else:
            predicted = low_passed(simulated[channel], GRID)
            if channel in view.holes:
                values = values + _filled(view, channel, simulated[channel], prepared.hub is not None)
        off = values - predicted
        if prepared.recording.start == "unknown" and channel != "motor_torque":
            # Without a rest at the start the zero of a bridge is not known.
            off = off - np.median(off[view.known[channel]])
        parts[channel] = np.where(view.known[channel], off, 0.0)
    if prepared.hub is not None:
        drive_of = delivered(view, prepared, model)
        off = unmodelled(view, model, motion, required, drive_of)
        read = before_end(view.time, model.hub_late + LEFT_OUT)
        parts["hub_torque"] = np.where(view.sliding & read, off, 0.0)
        parts["break_away"] = break_aways(view, model, motion, required, drive_of)
        parts["departure"], _ = creep.residual(view.time, prepared, model, motion, view.departures)
    return parts


def _filled(view: View, channel: str, simulated: np.ndarray, moving: bool) -> np.ndarray:
    """Change (m) of a filtered strain if its missing readings are as simulated, off by as much as those beside them.

    A filter spreads what bridges a gap to its sides: as simulated, it leaves no trace in what is compared.
    """
    known, off = view.known[channel], view.holes[channel] - simulated
    between = np.interp(view.time, view.time[known], off[known]) if known.any() else off
    change = low_passed(np.where(known, 0.0, between - off), GRID)
    return low_passed(change, GRID, view.band) if moving else change


def _strains_only(asked: Recording) -> dict[str, np.ndarray]:
    return {c: v for c, v in asked.channels.items() if c != "motor_torque"}
