"""Plotly figures of a diagnosis: measured and simulated channels, residuals, and unmodelled quantities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.diagnosis.answer import LONGEST_GAP, MODELS, Patched, Prediction, Trace
from twin.labels import channel, over_noise, signed, unmodelled, variable
from twin.recording import CHANNEL_UNITS, Recording
from twin.report import pages
from twin.report.decimate import as_axis, decimate, thin
from twin.report.display import NOISE_LIKE
from twin.report.pages import Figure
from twin.report.panels import Panels, title

COLOURS: Mapping[str, str] = {
    "measured": pages.INK,
    "before": pages.VERMILION,
    "calibrated": pages.PURPLE,
    "after": pages.BLUE,
    "cloud": "#8d96a0",
    "noise": "#e3efe6",
}


def recording_figure(prediction: Prediction, points: int = 2000) -> Figure | None:
    """Returns measured and simulated channels beside their residuals; None if no channel was simulated.

    Left are the channels, right measured minus simulated in noise levels, on a scale that is linear up to two and
    logarithmic beyond, so that errors of the noise and of hundreds of noise levels are both visible; below is the
    command. All panels share the time axis. The unknown zero of a sensor is added to the simulated readings.

    Args:
      prediction: one recording with its simulations.
      points: about how many points a line keeps.
    """
    names = [name for name in prediction.measured.measured() if name in prediction.after]
    if not names:
        return None
    commanded = "torque_command" in prediction.measured and not prediction.measured.clamped
    page = Panels([1.0] * len(names) + [0.45] * commanded, row=175)
    for row, name in enumerate(names):
        _signal_panel(page, row, prediction, name, points)
        _residual_panel(page, row, prediction, name, points)
    if commanded:
        _command_panel(page, len(names), prediction.measured, points)
    page.time_below(0, len(names) + commanded)
    page.time_below(1, len(names))
    page.caption(0, "Measured and simulated")
    page.caption(1, "Measured − simulated, in noise levels")
    return page.figure()


@dataclass(frozen=True)
class JoinedTime:
    """Time axis that traces share, with the fit recordings one after the other.

    Attributes:
      end: of the axis [s].
      starts: of the recordings on it [s].
    """

    end: float
    starts: tuple[float, ...]

    @classmethod
    def of(cls, traces: Sequence[Trace]) -> JoinedTime:
        """Returns the axis that covers all of these traces."""
        starts = {round(float(t), 6) for trace in traces for t in np.unique(trace.time - trace.since_start)}
        return cls(
            max((float(t) for trace in traces for t in trace.time), default=0.0), tuple(sorted(starts))
        )


def headline_figure(
    prediction: Prediction, name: str, names: Mapping[str, str], points: int = 2000
) -> Figure:
    """Returns one channel of a recording: measured, and simulated before and after.

    Args:
      prediction: the recording with its simulations.
      name: of the channel.
      names: "measured", "before", "after" -> name of the line; others are not drawn.
      points: about how many points a line keeps.
    """
    shown = channel(name)
    page = Panels([1.0], row=330, columns=(1.0,))
    for model, label in names.items():
        recording = getattr(prediction, model)
        if name not in recording:
            continue
        line = _decimated_line(recording.time, shown.factor * prediction.reading(model, name), points)
        style = _style(model, wider=2.0 if model == "measured" else 0.7)
        page.add(0, 0, **line, **style | {"name": label}, hovertemplate=_hover(label, shown.unit))
    page.set(page.axes(0, 0)[1], title=title(shown.label, shown.unit))
    page.time_below(0, 1)
    return page.figure()


def trace_figure(trace: Trace, against: str | None, axis: JoinedTime) -> Figure | None:
    """Returns an unmodelled quantity over the variable that explains it, and over time; None if it is empty.

    Args:
      trace: the unmodelled quantity.
      against: name of the variable; None for a plot over time alone.
      axis: time axis.
    """
    kept = np.flatnonzero(np.isfinite(trace.values))
    if len(kept) < 2:
        return None
    page = Panels([1.0], row=340, columns=(0.46, 0.43) if against else (1.0,), linked=False)
    if against:
        _scatter_panel(page, 0, trace, against, kept)
    _time_panel(page, 1 if against else 0, trace, axis)
    return page.figure()


def other_variables_figure(trace: Trace, against: str | None) -> Figure | None:
    """Returns an unmodelled quantity over up to four variables other than `against` and time; None without any."""
    kept = np.flatnonzero(np.isfinite(trace.values))
    names = [name for name in trace.variables if name not in (against, "time")][:4]
    if len(kept) < 2 or not names:
        return None
    gap = 0.06
    width = (1.0 - gap * (len(names) - 1)) / len(names)
    page = Panels([1.0], row=230, columns=(width,) * len(names), linked=False, gap=gap)
    for column, name in enumerate(names):
        _scatter_panel(page, column, trace, name, kept, points=800, legend=False)
    return page.figure()


def patch_figure(patched: Patched) -> Figure | None:
    """Returns a lookup table over the range in which it was observed; marker sizes grow with the number of samples.

    None for a table of a single entry.
    """
    patch = patched.patch
    if len(patch.x) < 2:
        return None
    shown = variable(patch.variable)
    adds = channel(patch.channel) if patch.channel in CHANNEL_UNITS else channel("motor_torque")
    page = Panels([1.0], row=280, columns=(1.0,), linked=False)
    x, y = shown.factor * patch.x, adds.factor * patch.y
    size = 3 + 7 * np.sqrt(patch.count / patch.count.max())
    hover = f"%{{y:.4g}} {adds.unit} at %{{x:.4g}} {shown.unit}<extra></extra>"
    marker = {"color": COLOURS["after"], "size": size.astype("f4")}
    line = {"color": COLOURS["after"], "width": 1.8}
    page.add(
        0, 0, x=x, y=y, mode="lines+markers", line=line, marker=marker, name="lookup", hovertemplate=hover
    )
    page.set(page.axes(0, 0)[0], title=title(shown.label, shown.unit))
    page.set(page.axes(0, 0)[1], title=title(f"added to {adds.label}", adds.unit))
    return page.figure()


def _decimated_line(time: np.ndarray, values: np.ndarray, points: int) -> dict[str, np.ndarray]:
    kept = decimate(values, points)
    return {"x": as_axis(time[kept]), "y": values[kept].astype("f4")}


def _signal_panel(page: Panels, row: int, prediction: Prediction, name: str, points: int) -> None:
    shown = channel(name)
    for model in ("measured", *MODELS):
        recording = getattr(prediction, model)
        if name not in recording:
            continue
        line = _decimated_line(recording.time, shown.factor * prediction.reading(model, name), points)
        page.add(
            row, 0, **line, **_style(model), showlegend=row == 0, hovertemplate=_hover(model, shown.unit)
        )
    page.set(page.axes(row, 0)[1], title=title(shown.label, shown.unit))


_STYLES: Mapping[str, tuple[str, float, str]] = {
    "measured": ("#b4bac1", 4.0, "solid"),
    "before": (COLOURS["before"], 1.6, "8px,4px"),
    "calibrated": (COLOURS["calibrated"], 1.4, "6px,3px,1px,3px"),
    "after": (COLOURS["after"], 1.8, "2px,2px"),
}
"""Colour, width [px] and dash of each line, told apart without colours, too."""


def _style(model: str, wider: float = 0.0) -> dict[str, Any]:
    """How a line is drawn; `wider` than usual [px]."""
    colour, width, dash = _STYLES[model]
    style: dict[str, Any] = {"mode": "lines", "name": model, "legendgroup": model}
    # The calibrated model is hidden at first; a click on its name in the legend shows it.
    visible = {"visible": "legendonly"} if model == "calibrated" else {}
    return style | visible | {"line": {"color": colour, "width": width + wider, "dash": dash}}


def _hover(name: str, unit: str) -> str:
    return f"{name}: %{{y:.4g}} {unit}<br>%{{x:.3f}} s<extra></extra>"


# Residuals: linear within the noise, logarithmic beyond it


def symmetric_log(x: np.ndarray | float) -> np.ndarray:
    """Returns asinh(x/NOISE_LIKE)/ln 10: linear up to about NOISE_LIKE, logarithmic beyond, a decade per unit."""
    return np.arcsinh(np.asarray(x, dtype=float) / NOISE_LIKE) / math.log(10)


def _residual_panel(page: Panels, row: int, prediction: Prediction, name: str, points: int) -> None:
    shown, error = channel(name), prediction.errors.get(name)
    sigma = error.noise if error is not None and over_noise(error.noise, error.noise) == 1.0 else None
    axis = page.axes(row, 1)[1]
    largest = 0.0
    for model in MODELS:
        recording = getattr(prediction, model)
        if name not in recording:
            continue
        residual = prediction.residual(model, name)
        drawn = symmetric_log(residual / sigma) if sigma else shown.factor * residual
        kept = decimate(drawn, points)
        real = (shown.factor * residual[kept]).astype("f4")
        line = {"x": as_axis(recording.time[kept]), "y": drawn[kept].astype("f4"), "customdata": real}
        hover = f"measured − {model}: %{{customdata:.3g}} {shown.unit}<br>%{{x:.3f}} s<extra></extra>"
        style = _style(model, -0.5) | {"showlegend": False}
        # Noise as dots is a cloud.
        style["line"] |= {"dash": "solid"} if model == "after" else {}
        page.add(row, 1, **line, **style, hovertemplate=hover)
        if model != "calibrated" and np.isfinite(drawn).any():
            largest = max(largest, float(np.nanmax(np.abs(drawn))))
    if sigma:
        _noise_band(page, row, axis)
        page.set(axis, title=title(shown.label, ""), **_symmetric_log_ticks(largest))
    else:
        page.set(axis, title=title("residual", shown.unit))


def _noise_band(page: Panels, row: int, axis: str) -> None:
    half = float(symmetric_log(2.0))
    x = page.axes(row, 1)[0]
    band = {"type": "rect", "xref": f"{x} domain", "x0": 0, "x1": 1, "yref": axis, "y0": -half, "y1": half}
    page.layout["shapes"].append(
        {**band, "fillcolor": COLOURS["noise"], "line": {"width": 0}, "layer": "below"}
    )


def _symmetric_log_ticks(largest: float) -> dict[str, Any]:
    decades = [10**k for k in range(1, 7) if symmetric_log(10**k) < 1.05 * largest]
    # The panel is small: labels that would overlap are left out.
    decades = decades[-1::-2][::-1] if len(decades) > 3 else decades
    if largest < symmetric_log(80):
        decades = [2, *decades]
    ticks = [-d for d in reversed(decades)] + [0] + decades
    reach = max(1.08 * largest, float(symmetric_log(3.5)))
    labels = [signed(t, 0) for t in ticks]
    return {
        "tickvals": [float(symmetric_log(t)) for t in ticks],
        "ticktext": labels,
        "range": [-reach, reach],
    }


def _command_panel(page: Panels, row: int, measured: Recording, points: int) -> None:
    shown = channel("torque_command")
    line = _decimated_line(measured.time, shown.factor * measured["torque_command"], points)
    style = {"mode": "lines", "line": {"color": "#6b747c", "width": 1.2, "shape": "hv"}, "name": "command"}
    page.add(row, 0, **line, **style, showlegend=False, hovertemplate=_hover("command", shown.unit))
    page.set(page.axes(row, 0)[1], title=title("command", shown.unit), nticks=4)


# Unmodelled quantities


def _scatter_panel(
    page: Panels,
    column: int,
    trace: Trace,
    against: str,
    kept: np.ndarray,
    points: int = 2500,
    legend: bool = True,
) -> None:
    shown, left = variable(against), unmodelled(trace.channel)
    x = shown.factor * np.asarray(trace.variables[against])
    kept = kept[np.isfinite(x[kept])]
    few = kept[thin(len(kept), points)]
    hover = f"%{{y:.4g}} {left.unit} at %{{x:.4g}} {shown.unit}<extra></extra>"
    marker = {"color": COLOURS["cloud"], "size": 4 if legend else 3, "opacity": 0.5}
    cloud = {"x": x[few].astype("f4"), "y": (left.factor * trace.values[few]).astype("f4"), "mode": "markers"}
    page.add(0, column, **cloud, marker=marker, name="unmodelled", showlegend=legend, hovertemplate=hover)
    if trace.fitted is not None and legend:
        fitted = cloud | {"y": (left.factor * trace.fitted[few]).astype("f4")}
        marker = {"color": COLOURS["after"], "size": 3.5}
        page.add(0, column, **fitted, marker=marker, name="effects found", hovertemplate=hover)
    page.set(page.axes(0, column)[0], title=title(shown.label, shown.unit))
    if column == 0:
        page.set(page.axes(0, column)[1], title=title(left.label, left.unit))
    if not legend:
        page.set(page.axes(0, column)[1], nticks=5)
        page.set(page.axes(0, column)[0], nticks=5)


def _time_panel(page: Panels, column: int, trace: Trace, axis: JoinedTime) -> None:
    left = unmodelled(trace.channel)
    x, y = page.axes(0, column)
    for at in axis.starts[1:]:
        border = {"type": "line", "xref": x, "x0": at, "x1": at, "yref": f"{y} domain", "y0": 0, "y1": 1}
        page.layout["shapes"].append({**border, "line": {"color": pages.GREY, "width": 1, "dash": "dot"}})
    # A wide line behind a thin one stays visible.
    behind = 1.0 if trace.fitted is None else 3.0
    lines = (
        ("unmodelled", trace.values, "#b9c0c7", behind),
        ("effects found", trace.fitted, COLOURS["after"], 1.0),
    )
    for name, values, colour, width in lines:
        if values is None:
            continue
        line = _broken_line(trace, left.factor * np.asarray(values), 2500)
        style = {"mode": "lines", "line": {"color": colour, "width": width}}
        page.add(
            0,
            column,
            **line,
            **style,
            name=name,
            showlegend=column == 0,
            hovertemplate=_hover(name, left.unit),
        )
    page.set(x, title=title("time, fit recordings one after the other", "s"), range=[0.0, axis.end])
    if column == 0:
        page.set(y, title=title(left.label, left.unit))


def _broken_line(trace: Trace, values: np.ndarray, points: int) -> dict[str, np.ndarray]:
    """Returns values (n) of a trace over time as a line that breaks between recordings and at gaps."""
    order = np.argsort(trace.time, kind="stable")
    time, values = np.asarray(trace.time)[order], values[order]
    anew = (np.diff(time) > LONGEST_GAP) | (np.diff(np.asarray(trace.recording)[order]) != 0)
    pieces = np.split(np.arange(len(time)), np.flatnonzero(anew) + 1)
    kept = [piece[decimate(values[piece], max(2, points * len(piece) // len(time)))] for piece in pieces]
    breaks = np.cumsum([len(piece) for piece in kept])[:-1]
    joined = np.concatenate(kept)
    return {
        axis: np.insert(v[joined], breaks, np.nan).astype("f4") for axis, v in (("x", time), ("y", values))
    }
