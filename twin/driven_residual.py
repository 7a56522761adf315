"""What is left of a recording where its hub moves the model, in noise units."""

from __future__ import annotations

import numpy as np

from twin import departures
from twin.fit import Prepared
from twin.hub_balance import break_aways, delivered, read_torque, unmodelled
from twin.low_pass import GRID, low_passed
from twin.model import Model, Start, reported
from twin.recording import Recording
from twin.view import View, move, whitened


def residual(
    view: View, prepared: Prepared, model: Model, start: Start, white: bool = True
) -> dict[str, np.ndarray]:
    """Name -> (m) measured minus simulated in noise units; `hub_torque` is the unmodelled torque on the hub.

    Where they are `white`, strains have passed the filter of `whitened`, and both strains and torque their `ringing`,
    and stretches in which the noise swells are as quiet as the others.
    """
    motion, required = move(view, prepared, model, start)
    asked = Recording("", view.time, {c: np.zeros(len(view.time)) for c in view.measured})
    parts = {}
    simulated = reported(model, asked.replace(channels=_strains_only(asked)), motion)
    for channel, values in view.measured.items():
        if channel == "motor_torque":
            predicted = read_torque(view, prepared, model)
        else:
            predicted = low_passed(simulated[channel], GRID)
            if channel in view.holes:
                values = values + _filled(view, channel, simulated[channel], prepared.hub is not None)
        missing = values - predicted
        if prepared.recording.start == "unknown" and channel != "motor_torque":
            # Without a rest at the start the zero of a bridge is not known.
            missing = missing - np.median(missing[view.known[channel]])
        missing = np.where(view.known[channel], missing, 0.0)
        parts[channel] = whitened(missing, view, channel) if white else missing / view.noise[channel]
    if prepared.hub is not None:
        drive_of = delivered(view, prepared, model)
        missing = unmodelled(view, model, motion, required, drive_of)
        parts["hub_torque"] = np.where(view.sliding, missing / view.noise["hub_torque"], 0.0)
        parts["break_away"] = break_aways(view, model, motion, required, drive_of)
        parts["departure"], _ = departures.residual(view.time, prepared, model, motion, view.departures)
    if not white:
        return parts
    parts |= {name: r.whitened(parts[name]) for name, r in view.ringing.items()}
    return parts | {name: parts[name] / swell for name, swell in view.swell.items()}


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
