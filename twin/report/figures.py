"""Plotly figures of a diagnosis: measured and simulated channels, residuals, and unmodelled quantities."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.diagnosis.answer import LONGEST_GAP, Patched, Prediction, Trace
from twin.labels import channel, over_noise, unmodelled, variable
from twin.recording import CHANNEL_UNITS, Recording
from twin.report import pages
from twin.report.decimate import decimate, thin
from twin.report.display import MODELS, NOISE_LIKE

COLOURS: Mapping[str, str] = {
    "measured": pages.INK,
    "before": pages.VERMILION,
    "calibrated": "#b3558f",
    "after": pages.BLUE,
    "cloud": "#8d96a0",
    "noise": "#e3efe6",
}

_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
_GRID, _AXIS = "#e9ecef", pages.GREY


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    Attributes:
      json: data and layout for plotly.js.
      height: on the page [px].
    """

    json: str
    height: int


def recording_figure(prediction: Prediction, points: int = 2000) -> Figure | None:
    """Returns measured and simulated channels beside their residuals; None if no channel was simulated.

    Left are the channels, right measured minus simulated in noise levels, on a scale that is linear up to two and
    logarithmic beyond, so that errors of the noise and of hundreds of noise levels are both visible; below is the
    command. All panels share the time axis.

    Args:
      prediction: one recording with its simulations.
      points: about how many points a line keeps.
    """
    names = [name for name in prediction.measured.measured() if name in prediction.after]
    if not names:
        return None
    commanded = "torque_command" in prediction.measured and not prediction.measured.clamped
    page = _Panels([1.0] * len(names) + [0.45] * commanded, row=175)
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


def trace_figure(trace: Trace, against: str | None, axis: JoinedTime) -> Figure | None:
    """Returns an unmodelled quantity over the variable that explains it, and over time; None if it is empty.

    Args:
      trace: the unmodelled quantity.
      against: name of the variable; None for a plot over time alone.
      axis: time axis.
    """
    kept = np.flatnonzero(np.isfinite(trace.values))
    if not len(kept):
        return None
    page = _Panels([1.0], row=340, columns=(0.46, 0.43) if against else (1.0,), linked=False)
    if against:
        _scatter_panel(page, 0, trace, against, kept)
    _time_panel(page, 1 if against else 0, trace, axis)
    return page.figure()


def other_variables_figure(trace: Trace, against: str | None) -> Figure | None:
    """Returns an unmodelled quantity over up to four variables other than `against` and time; None without any."""
    kept = np.flatnonzero(np.isfinite(trace.values))
    names = [name for name in trace.variables if name not in (against, "time")][:4]
    if not len(kept) or not names:
        return None
    gap = 0.06
    width = (1.0 - gap * (len(names) - 1)) / len(names)
    page = _Panels([1.0], row=230, columns=(width,) * len(names), linked=False, gap=gap)
    for column, name in enumerate(names):
        _scatter_panel(page, column, trace, name, kept, points=800, legend=False)
    return page.figure()


def patch_figure(patched: Patched) -> Figure:
    """Returns a lookup table over the range in which it was observed; marker sizes grow with the number of samples."""
    patch = patched.patch
    shown = variable(patch.variable)
    adds = channel(patch.channel) if patch.channel in CHANNEL_UNITS else channel("motor_torque")
    page = _Panels([1.0], row=280, columns=(1.0,), linked=False)
    x, y = shown.factor * patch.x, adds.factor * patch.y
    size = 3 + 7 * np.sqrt(patch.count / patch.count.max())
    hover = f"%{{y:.4g}} {adds.unit} at %{{x:.4g}} {shown.unit}<extra></extra>"
    marker = {"color": COLOURS["after"], "size": size.astype("f4")}
    line = {"color": COLOURS["after"], "width": 1.8}
    page.add(
        0, 0, x=x, y=y, mode="lines+markers", line=line, marker=marker, name="lookup", hovertemplate=hover
    )
    page.set(page.axes(0, 0)[0], title=_title(shown.label, shown.unit))
    page.set(page.axes(0, 0)[1], title=_title(f"added to {adds.label}", adds.unit))
    return page.figure()


class _Panels:
    """Panels in rows and columns, as plotly axes.

    Args:
      rows: relative height of each row.
      row: height of a row of relative height 1 [px].
      columns: width of each column, over that of the figure [1].
      linked: whether all panels share the x axis of the first.
      gap: between columns, over the width of the figure [1]; None to fill the width.
    """

    def __init__(
        self,
        rows: list[float],
        row: int,
        columns: tuple[float, ...] = (0.55, 0.38),
        linked: bool = True,
        gap: float | None = None,
    ):
        self.linked = linked
        self.rows, self.columns = rows, columns
        self.data: list[dict[str, Any]] = []
        self.layout: dict[str, Any] = {"annotations": [], "shapes": []}
        self.top, self.bottom, between = 58, 44, 22
        self.inner = int(row * sum(rows) + between * (len(rows) - 1))
        self.space = between / self.inner
        spare = 1.0 - sum(columns)
        self.gap = gap if gap is not None else spare / max(len(columns) - 1, 1)

    def axes(self, row: int, column: int) -> tuple[str, str]:
        """Returns the names of the axes of a panel; they are created on first use."""
        number = row * len(self.columns) + column + 1
        suffix = "" if number == 1 else str(number)
        if f"xaxis{suffix}" not in self.layout:
            self._make_axes(row, column, suffix)
        return f"x{suffix}", f"y{suffix}"

    def _make_axes(self, row: int, column: int, suffix: str) -> None:
        left = sum(self.columns[:column]) + self.gap * column
        whole = sum(self.rows)
        unit = (1.0 - self.space * (len(self.rows) - 1)) / whole
        top = 1.0 - sum(self.rows[:row]) * unit - self.space * row
        style = {"gridcolor": _GRID, "linecolor": _AXIS, "zeroline": False, "ticks": "outside", "ticklen": 3}
        style |= {"tickcolor": _AXIS, "showline": True}
        x = {**style, "domain": [left, left + self.columns[column]], "anchor": f"y{suffix}"}
        if self.linked and suffix:
            x["matches"] = "x"
        y = {**style, "domain": [max(top - self.rows[row] * unit, 0.0), top], "anchor": f"x{suffix}"}
        self.layout |= {f"xaxis{suffix}": x, f"yaxis{suffix}": y | {"automargin": False}}

    def set(self, axis: str, **options: Any) -> None:
        """Changes an axis, say "x3"."""
        self.layout[f"{axis[0]}axis{axis[1:]}"] |= options

    def add(self, row: int, column: int, **trace: Any) -> None:
        """Adds a trace to a panel."""
        x, y = self.axes(row, column)
        self.data.append({"type": "scatter", "xaxis": x, "yaxis": y, **trace})

    def time_below(self, column: int, rows: int) -> None:
        """Labels the time axis below the last panel of a column only."""
        for row in range(rows):
            last = row == rows - 1
            self.set(self.axes(row, column)[0], showticklabels=last)
            if last:
                self.set(self.axes(row, column)[0], title=_title("time", "s"))

    def caption(self, column: int, text: str) -> None:
        """Adds a caption above a column of panels."""
        left = sum(self.columns[:column]) + self.gap * column
        place = {
            "x": left,
            "y": 1.0,
            "xref": "paper",
            "yref": "paper",
            "xanchor": "left",
            "yanchor": "bottom",
        }
        font = {"size": 12.5, "color": "#444"}
        self.layout["annotations"].append(
            {**place, "text": text, "showarrow": False, "yshift": 6, "font": font}
        )

    def figure(self) -> Figure:
        """Returns the panels as JSON that is safe inside a script element."""
        import plotly.graph_objects as go

        height = self.inner + self.top + self.bottom
        legend = {"orientation": "h", "x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom"}
        legend |= {"yref": "container", "bgcolor": "rgba(0,0,0,0)", "font": {"size": 13}}
        legend |= {"y": 0.995, "yanchor": "top", "itemsizing": "constant"}
        layout = {
            **self.layout,
            "template": go.layout.Template(),
            "font": {"family": _FONT, "size": 12, "color": "#333"},
            "margin": {"l": 66, "r": 12, "t": self.top, "b": self.bottom},
            "height": height,
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "hovermode": "closest",
            "legend": legend,
        }
        text = go.Figure(self.data, layout).to_json()
        # "</script>" or "<!--" inside would end or break the enclosing element.
        return Figure(text.replace("<", "\\u003c").replace("\u2028", "\\u2028"), height)


def _decimated_line(time: np.ndarray, values: np.ndarray, points: int) -> dict[str, np.ndarray]:
    kept = decimate(values, points)
    return {"x": time[kept].astype("f4"), "y": values[kept].astype("f4")}


def _signal_panel(page: _Panels, row: int, prediction: Prediction, name: str, points: int) -> None:
    shown = channel(name)
    series = {"measured": prediction.measured, **{model: getattr(prediction, model) for model in MODELS}}
    for model, recording in series.items():
        if name not in recording:
            continue
        line = _decimated_line(recording.time, shown.factor * recording[name], points)
        page.add(
            row, 0, **line, **_style(model), showlegend=row == 0, hovertemplate=_hover(model, shown.unit)
        )
    page.set(page.axes(row, 0)[1], title=_title(shown.label, shown.unit))


def _style(model: str) -> dict[str, Any]:
    width = {"measured": 2.6, "before": 1.4, "calibrated": 1.4, "after": 1.6}[model]
    dash = {"measured": "solid", "before": "solid", "calibrated": "dot", "after": "5px,3px"}[model]
    colour = "#a9b0b7" if model == "measured" else COLOURS[model]
    style: dict[str, Any] = {"mode": "lines", "name": model, "legendgroup": model}
    # The calibrated model is hidden at first; a click on its name in the legend shows it.
    visible = {"visible": "legendonly"} if model == "calibrated" else {}
    return style | visible | {"line": {"color": colour, "width": width, "dash": dash}}


def _hover(name: str, unit: str) -> str:
    return f"{name}: %{{y:.4g}} {unit}<br>%{{x:.3f}} s<extra></extra>"


def _title(label: str, unit: str) -> dict[str, Any]:
    text = f"{html.escape(label)} [{html.escape(unit)}]" if unit else html.escape(label)
    return {"text": text, "font": {"size": 12}, "standoff": 4}


# Residuals: linear within the noise, logarithmic beyond it


def symmetric_log(x: np.ndarray | float) -> np.ndarray:
    """Returns asinh(x/NOISE_LIKE)/ln 10: linear up to about NOISE_LIKE, logarithmic beyond, a decade per unit."""
    return np.arcsinh(np.asarray(x, dtype=float) / NOISE_LIKE) / math.log(10)


def _residual_panel(page: _Panels, row: int, prediction: Prediction, name: str, points: int) -> None:
    shown, error = channel(name), prediction.errors.get(name)
    sigma = error.noise if error is not None and over_noise(error.noise, error.noise) == 1.0 else None
    axis = page.axes(row, 1)[1]
    largest = 0.0
    for model in MODELS:
        recording = getattr(prediction, model)
        if name not in recording:
            continue
        residual = prediction.measured[name] - recording[name]
        drawn = symmetric_log(residual / sigma) if sigma else shown.factor * residual
        kept = decimate(drawn, points)
        real = (shown.factor * residual[kept]).astype("f4")
        line = {"x": recording.time[kept].astype("f4"), "y": drawn[kept].astype("f4"), "customdata": real}
        hover = f"measured − {model}: %{{customdata:.3g}} {shown.unit}<br>%{{x:.3f}} s<extra></extra>"
        style = _style(model) | {"line": {"color": COLOURS[model], "width": 1}, "showlegend": False}
        page.add(row, 1, **line, **style, hovertemplate=hover)
        if model != "calibrated" and np.isfinite(drawn).any():
            largest = max(largest, float(np.nanmax(np.abs(drawn))))
    if sigma:
        _noise_band(page, row, axis)
        page.set(axis, **_symmetric_log_ticks(largest))
    else:
        page.set(axis, title=_title("residual", shown.unit))


def _noise_band(page: _Panels, row: int, axis: str) -> None:
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
    labels = [f"{t:+d}".replace("-", "−") if t else "0" for t in ticks]
    return {
        "tickvals": [float(symmetric_log(t)) for t in ticks],
        "ticktext": labels,
        "range": [-reach, reach],
    }


def _command_panel(page: _Panels, row: int, measured: Recording, points: int) -> None:
    shown = channel("torque_command")
    line = _decimated_line(measured.time, shown.factor * measured["torque_command"], points)
    style = {"mode": "lines", "line": {"color": "#6b747c", "width": 1.2, "shape": "hv"}, "name": "command"}
    page.add(row, 0, **line, **style, showlegend=False, hovertemplate=_hover("command", shown.unit))
    page.set(page.axes(row, 0)[1], title=_title("command", shown.unit), nticks=4)


# Unmodelled quantities


def _scatter_panel(
    page: _Panels,
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
    page.add(0, column, **cloud, marker=marker, name="unexplained", showlegend=legend, hovertemplate=hover)
    if trace.fitted is not None and legend:
        fitted = cloud | {"y": (left.factor * trace.fitted[few]).astype("f4")}
        marker = {"color": COLOURS["after"], "size": 3.5}
        page.add(0, column, **fitted, marker=marker, name="fitted effect", hovertemplate=hover)
    page.set(page.axes(0, column)[0], title=_title(shown.label, shown.unit))
    if column == 0:
        page.set(page.axes(0, column)[1], title=_title(left.label, left.unit))
    if not legend:
        page.set(page.axes(0, column)[1], nticks=5)
        page.set(page.axes(0, column)[0], nticks=5)


def _time_panel(page: _Panels, column: int, trace: Trace, axis: JoinedTime) -> None:
    left = unmodelled(trace.channel)
    x, y = page.axes(0, column)
    for at in axis.starts[1:]:
        border = {"type": "line", "xref": x, "x0": at, "x1": at, "yref": f"{y} domain", "y0": 0, "y1": 1}
        page.layout["shapes"].append({**border, "line": {"color": _AXIS, "width": 1, "dash": "dot"}})
    # A wide line behind a thin one stays visible.
    behind = 1.0 if trace.fitted is None else 3.0
    lines = (
        ("unexplained", trace.values, "#b9c0c7", behind),
        ("fitted effect", trace.fitted, COLOURS["after"], 1.0),
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
    page.set(x, title=_title("time, fit recordings one after the other", "s"), range=[0.0, axis.end])
    if column == 0:
        page.set(y, title=_title(left.label, left.unit))


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
