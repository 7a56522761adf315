"""The first state of a rig that was already moving when its recording began.

The hub's motion is read; how far its link is bent then, and how fast it bends, shows in the gauges in the moments that
follow.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from twin.estimation.minimise import minimise
from twin.estimation.unknowns import start_unknowns
from twin.estimation.workbench import GuidedData, Workbench
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.residuals.make_view import look
from twin.residuals.prepared import Prepared, prepare, reading_start
from twin.residuals.residual import missing
from twin.residuals.view import LEFT_OUT, View, before_end
from twin.rigs.model import Model
from twin.rigs.simulate import bending_shapes

_SPANS = (0.15, 0.25, 0.5)
"""Spans at the start of a recording from which its first state is estimated, one after the other [s]."""
_FREE = 1.0  # s from which that of a simulation that runs freely is estimated
_SCALES = (1e-4, 1e-4, 1e-3, 1e-3)  # of bends [m] and their rates [m/s]: small beside visible ones
_ROUNDS = 10
_FIRST = 0.05  # s over which a first value and slope are read


def first_state(model: Model, prepared: Prepared, pool: ThreadPoolExecutor) -> Start:
    """State at the first sample as the readings tell it: those of it, or of the first second of a moving rig."""
    if prepared.recording.start != "unknown":
        return reading_start(model, prepared, prepared.start)
    short = with_bend(_head(prepared, _FREE), model)
    bench = Workbench(GuidedData([short]), pool)
    return minimise(bench, model, [short.start], start_unknowns([short]), iterations=6).starts[0]


def with_bend(prepared: Prepared, model: Model) -> Prepared:
    """The recording with the bend and the rate of bending at its first sample, if it began in motion.

    The shapes of the first two clamped modes turn the strains and their slopes into a first guess. Least squares on the
    strains of the first moments improve it, of few and then of more (without strains: on the torque that the motion of
    the hub takes), each but for a constant: the zero of a bridge is not known.
    """
    if prepared.recording.start != "unknown":
        return prepared
    start = _read(prepared, model)
    for span in _SPANS:
        short = replace(_head(prepared, span), start=start)
        start = _settled(look(short, model), short, model)
    return replace(prepared, start=start)


def _head(prepared: Prepared, span: float) -> Prepared:
    """The first moments of a recording [s]."""
    recording = prepared.recording
    return prepare(recording.part(recording.time <= recording.time[0] + span), prepared.noise)[0]


def _settled(view: View, short: Prepared, model: Model) -> Start:
    """The bends and rates, near the first ones, with which the least is left."""

    def remains(x: np.ndarray) -> np.ndarray:
        return _left(view, short, model, _bent(short.start, x))

    first = np.array([*short.start.bend, *short.start.bend_rate])
    if len(remains(first)) < len(first):
        return short.start
    found = least_squares(remains, first, x_scale=_SCALES, max_nfev=_ROUNDS)
    return _bent(short.start, found.x)


def _read(prepared: Prepared, model: Model) -> Start:
    """The first bends and their rates that the strains are those of, by their shapes alone."""
    recording = prepared.recording
    gauges = [c for c in prepared.channels if c in model.curvature_rows]
    if not gauges:
        return prepared.start
    shapes = bending_shapes(model.chain)[:, : len(gauges)]
    rows = np.stack([model.sensors[c].half_thickness * model.curvature_rows[c] @ shapes for c in gauges])
    lines = [_line(recording, c) for c in gauges]
    bends = np.zeros((2, 2))
    bends[: shapes.shape[1]] = np.linalg.lstsq(rows, np.array(lines))[0]
    return _bent(prepared.start, bends.T.ravel())


def _line(recording: Recording, channel: str) -> tuple[float, float]:
    """First value, off the middle of all, and slope of a channel's parabola through its first moments."""
    known = np.isfinite(recording[channel])
    first = known & (recording.time < recording.time[0] + _FIRST)
    if first.sum() < 4:
        return 0.0, 0.0
    parabola = np.polyfit(recording.time[first] - recording.time[0], recording[channel][first], 2)
    return float(parabola[2] - np.median(recording[channel][known])), float(parabola[1])


def _left(view: View, prepared: Prepared, model: Model, start: Start) -> np.ndarray:
    """What is left of what tells the bend, in noise units, but for its means."""
    left = missing(view, prepared, model, start)
    told = [c for c in view.measured if c != "motor_torque"] or [c for c in left if c == "hub_torque"]
    sure = before_end(view.time, LEFT_OUT) & (view.time >= view.time[0] + LEFT_OUT)
    pieces = [np.zeros(0)]
    for name in told:
        values = left[name][sure & (view.sliding if name == "hub_torque" else view.known[name])]
        pieces.append((values - values.mean()) / view.noise[name] if len(values) else values)
    return np.clip(np.nan_to_num(np.concatenate(pieces), nan=1e6), -1e6, 1e6)


def _bent(start: Start, x: np.ndarray) -> Start:
    """The first state with two bends [m] and their rates [m/s]."""
    bend_0, bend_1, rate_0, rate_1 = map(float, x)
    return replace(start, bend=(bend_0, bend_1), bend_rate=(rate_0, rate_1))
