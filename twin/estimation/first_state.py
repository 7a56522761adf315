"""Initial state of a rig that was already moving at the first sample of its recording.

Angle and rate of the hub follow from the readings. The bend of the link and its rate are estimated from the strains of
the first moments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import start_unknowns
from twin.estimation.workbench import GuidedData, Workbench, finite
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.residuals.filters import REACH
from twin.residuals.make_view import make_view
from twin.residuals.numerics import MOST_EVALUATIONS
from twin.residuals.prepared import Prepared, prepare, sensor_corrected_start
from twin.residuals.residual import raw_residual
from twin.residuals.view import View, before_end
from twin.rigs.model import Model
from twin.rigs.simulate import bending_shapes

SPANS = (0.15, 0.25, 0.5)
"""Spans at the start of a recording from which the bend is estimated, one after the other [s]: the longer, the less the
noise of a rough sensor matters, and the more the errors of the model do."""
FREE_RUN_SPAN = 1.0
"""Span at the start of a recording from which the state of a free-running simulation is estimated [s]."""


def first_state(model: Model, prepared: Prepared, pool: ResidualPool) -> Start:
    """State at the first sample for a free-running simulation.

    From the first reading; of a rig that was moving, fitted to the first second of guided simulations.
    """
    if prepared.recording.start != "unknown":
        return sensor_corrected_start(model, prepared, prepared.start)
    short = with_bend(_head(prepared, FREE_RUN_SPAN), model)
    bench = Workbench(GuidedData([short]), pool)
    return minimise(bench, model, [short.start], start_unknowns([short])).starts[0]


def first_states(model: Model, recordings: Sequence[Prepared], pool: ResidualPool) -> list[Start]:
    """The `first_state` of each recording, found side by side."""
    return pool.spread(_first_state_of, [(model, p) for p in recordings])


def _first_state_of(given: tuple[Model, Prepared], pool: ResidualPool) -> Start:
    return first_state(*given, pool)


def with_bends(recordings: Sequence[Prepared], model: Model, pool: ResidualPool) -> list[Prepared]:
    """Each recording `with_bend`, found side by side."""
    return pool.spread(_with_bend_of, [(p, model) for p in recordings])


def _with_bend_of(given: tuple[Prepared, Model], pool: ResidualPool) -> Prepared:
    return with_bend(*given)


def with_bend(prepared: Prepared, model: Model) -> Prepared:
    """The recording with the bend of the link and its rate at the first sample, if the rig was moving.

    The first guess is the combination of the first two clamped modes that has the measured strains and strain rates.
    It is improved by least squares on the strains of ever longer spans; without strains, on the torque on the hub that
    the modelled motion requires. The mean of each residual is left out, because the zero of a bridge is not known.
    """
    if prepared.recording.start != "unknown":
        return prepared
    start = _bend_from_strains(prepared, model)
    for span in SPANS:
        short = replace(_head(prepared, span), start=start)
        start = _fitted_bend(make_view(short, model), short, model)
    return replace(prepared, start=start)


def _head(prepared: Prepared, span: float) -> Prepared:
    """The recording cut to its first span [s]."""
    recording = prepared.recording
    return prepare(recording.part(recording.time <= recording.time[0] + span), prepared.noise)[0]


def _fitted_bend(view: View, short: Prepared, model: Model) -> Start:
    """The initial state with the bend and rate of least squares; unchanged where there are too few residuals."""

    def residual(x: np.ndarray) -> np.ndarray:
        return _bend_residual(view, short, model, _with_bend(short.start, x))

    first = np.array([*short.start.bend, *short.start.bend_rate])
    if len(residual(first)) < len(first):
        return short.start
    solution = least_squares(residual, first, x_scale="jac", max_nfev=MOST_EVALUATIONS)
    return _with_bend(short.start, solution.x)


def _bend_from_strains(prepared: Prepared, model: Model) -> Start:
    """The initial state with the bend and rate of the first one or two clamped modes that give the first strains."""
    recording = prepared.recording
    gauges = [c for c in prepared.channels if c in model.strain_rows]
    if not gauges:
        return prepared.start
    shapes = bending_shapes(model.chain)[:, : len(gauges)]
    rows = np.stack([model.strain_rows[c] @ shapes for c in gauges])
    lines = [_value_and_slope(recording, c) for c in gauges]
    bends = np.zeros((2, 2))
    bends[: shapes.shape[1]] = np.linalg.lstsq(rows, np.array(lines))[0]
    return _with_bend(prepared.start, bends.T.ravel())


def _value_and_slope(recording: Recording, channel: str) -> tuple[float, float]:
    """Value less the median of the channel, and slope, at the first sample by a parabola; 0 with too few readings."""
    known = np.isfinite(recording[channel])
    first = known & (recording.time < recording.time[0] + REACH)
    if first.sum() < 4:
        return 0.0, 0.0
    parabola = np.polyfit(recording.time[first] - recording.time[0], recording[channel][first], 2)
    return float(parabola[2] - np.median(recording[channel][known])), float(parabola[1])


def _bend_residual(view: View, prepared: Prepared, model: Model, start: Start) -> np.ndarray:
    """Residuals (k) that depend on the bend, less their means: of the strains, without any of the torque on the hub.

    In multiples of the noise, without the margins in which the filter sees a mirror image.
    """
    residuals = raw_residual(view, prepared, model, start)
    names = [c for c in view.measured if c != "motor_torque"] or [c for c in residuals if c == "hub_torque"]
    inside = before_end(view.time, REACH) & (view.time >= view.time[0] + REACH)
    pieces = [np.zeros(0)]
    for name in names:
        values = residuals[name][inside & (view.sliding if name == "hub_torque" else view.known[name])]
        pieces.append((values - values.mean()) / view.noise[name] if len(values) else values)
    return finite(np.concatenate(pieces))


def _with_bend(start: Start, x: np.ndarray) -> Start:
    """The initial state with two bends [m] and their rates [m/s], x (4)."""
    bend_0, bend_1, rate_0, rate_1 = map(float, x)
    return replace(start, bend=(bend_0, bend_1), bend_rate=(rate_0, rate_1))
