"""Plotly figures of an identification, one for each procedure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin import labels
from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.compare_campaigns import Comparison
from twin.identification.decay import Decay
from twin.identification.estimates import TWO_SIDED_95, Identified
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import JointEstimate
from twin.identification.spectra import Response, peaks
from twin.identification.static_line import LoadLine
from twin.report import pages
from twin.report.decimate import thin

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEASURED, FITTED, OTHER, SOFT = pages.INK, pages.BLUE, pages.VERMILION, pages.GREY
"""Colours of measurements, of what is fitted to them, of a second series, and of secondary lines."""
_POINTS = 2000  # of a line
_DASHES = ("solid", "dash", "dot")
_LARGEST_CIRCLE = 16  # of a correlation of 1 [px]; plotly draws none larger than that in a legend


def load_line(line: LoadLine, column: str) -> Figure:
    """Returns the static test: displacement over load, with the fitted line."""
    figure = _figure(360)
    x = np.array([min(0.0, line.x.min()), line.x.max()])
    y = line.intercept.value + line.slope.value * x
    figure.add_scatter(x=line.x, y=1e3 * line.y, mode="markers", name="measured", marker=_dot(MEASURED))
    figure.add_scatter(x=x, y=1e3 * y, mode="lines", name="line", line={"color": FITTED})
    figure.update_xaxes(title_text="load [N]" if column.startswith("tip_") else column)
    figure.update_yaxes(title_text="tip displacement [mm]")
    return figure


def decay(ring_down: Decay) -> Figure:
    """Returns a ring-down with the envelope of its loss law."""
    shown = labels.channel(ring_down.channel)
    figure = _figure(380)
    kept = thin(len(ring_down.time), _POINTS)
    line = {"color": SOFT, "width": 1}
    figure.add_scatter(
        x=ring_down.time[kept], y=shown.factor * ring_down.values[kept], name="measured", line=line
    )
    envelope = _envelope(ring_down)
    for sign in (1, -1):
        style = {"color": FITTED, "width": 2}
        y = sign * shown.factor * envelope
        figure.add_scatter(
            x=ring_down.period_centre, y=y, mode="lines", name="envelope", line=style, showlegend=sign > 0
        )
    bars = {"type": "data", "array": shown.factor * ring_down.amplitude_error}
    points = {
        "x": ring_down.period_centre,
        "y": shown.factor * ring_down.amplitude,
        "error_y": bars,
        "marker": _dot(MEASURED),
    }
    figure.add_scatter(mode="markers", name="amplitude of a period", **points)
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text=f"{shown.label} [{shown.unit}]")
    return figure


def _envelope(ring_down: Decay) -> np.ndarray:
    """Amplitude (m) by the loss law from the first period on, integrated by Euler steps."""
    values = [ring_down.amplitude[0]]
    powers = np.arange(3)
    for step in np.diff(ring_down.period_centre):
        a = values[-1]
        for _ in range(50):
            a = max(a - step / 50 * float(ring_down.losses @ a**powers), 0.0)
        values.append(a)
    return np.array(values)


def break_aways(levels: StaticFriction) -> Figure:
    """Returns the break-away torque over the hub angle of each event."""
    figure = _figure(340)
    directions = ((1, FITTED, "circle", "towards positive"), (-1, OTHER, "diamond-open", "towards negative"))
    for direction, colour, symbol, name in directions:
        mine = [(e, s) for e, s in zip(levels.events, levels.errors, strict=True) if e.direction == direction]
        if mine:
            bars = {"type": "data", "array": [TWO_SIDED_95 * s for _, s in mine]}
            x, y = [np.degrees(e.angle) for e, _ in mine], [abs(e.torque) for e, _ in mine]
            figure.add_scatter(x=x, y=y, error_y=bars, mode="markers", name=name, marker=_dot(colour, symbol))
    figure.update_xaxes(title_text="hub angle [°]")
    # From zero, so that a spread of percents looks small.
    figure.update_yaxes(title_text="torque at break-away [N·m]", rangemode="tozero")
    return figure


def friction(hub: Balance) -> Figure:
    """Returns the friction torque by the hub's torque balance over the hub rate."""
    figure = _figure(380)
    kept = thin(len(hub.rate), _POINTS)
    cloud = {"color": SOFT, "size": 3, "opacity": 0.6}
    figure.add_scatter(
        x=hub.rate[kept], y=1e3 * hub.friction[kept], mode="markers", name="balance", marker=cloud
    )
    for direction in (1, -1):
        level = 1e3 * direction * hub.coulomb[direction].value
        x = [0.0, direction * float(np.abs(hub.rate).max(initial=1.0))]
        line = {"color": FITTED, "width": 3}
        figure.add_scatter(
            x=x, y=[level, level], mode="lines", name="Coulomb level", line=line, showlegend=direction > 0
        )
    figure.update_xaxes(title_text="rate of the hub [rad/s]")
    figure.update_yaxes(title_text="friction torque [mN·m]")
    return figure


def friction_map(release: FrictionMap) -> Figure:
    """Returns the equivalent damping of simulated decays over their Coulomb friction, and the measured damping."""
    figure = _figure(360)
    x, y = 1e3 * release.coulomb, 100 * release.damping
    figure.add_scatter(x=x, y=y, mode="lines+markers", name="simulated", line={"color": FITTED})
    figure.add_hline(y=100 * release.measured.value, line={"color": MEASURED, "dash": "dot"})
    if release.level is not None:
        bars = {"type": "data", "array": [1e3 * TWO_SIDED_95 * release.level.standard_error]}
        point = {"x": [1e3 * release.level.value], "y": [100 * release.measured.value], "error_x": bars}
        figure.add_scatter(mode="markers", name="measured", marker=_dot(MEASURED), **point)
    figure.update_xaxes(title_text="Coulomb friction [mN·m]")
    figure.update_yaxes(title_text="equivalent damping ratio [%]")
    return figure


def response(measured: Response) -> Figure:
    """Returns the frequency response by three estimators, and the coherence below."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=[0.7, 0.3], vertical_spacing=0.06)
    shown = np.where(measured.known, 1.0, np.nan)
    curves = (
        (measured.estimator, measured.h1, FITTED),
        ("H2", measured.h2, OTHER),
        ("Hv", measured.hv, SOFT),
    )
    for (name, values, colour), dash in zip(curves, _DASHES, strict=True):
        line = {"color": colour, "width": 1.6, "dash": dash}
        figure.add_scatter(x=measured.frequency, y=np.abs(values) * shown, name=name, line=line, row=1, col=1)
    for peak in peaks(measured):
        figure.add_vline(x=peak.frequency.value, line={"color": SOFT, "dash": "dot"}, row=1, col=1)
    line = {"color": MEASURED, "width": 1.2}
    figure.add_scatter(x=measured.frequency, y=measured.coherence, line=line, showlegend=False, row=2, col=1)
    figure.update_yaxes(
        title_text=f"{labels.channel(measured.channel).label} per N·m", type="log", dtick="D2", row=1, col=1
    )
    figure.update_yaxes(title_text="coherence", range=[0, 1.02], row=2, col=1)
    figure.update_xaxes(title_text="frequency [Hz]", row=2, col=1)
    return _styled(figure, 520)


def compared_responses(comparison: Comparison) -> Figure:
    """Returns the frequency responses of two campaigns of one rig."""
    figure = _figure(380)
    here, there = comparison.responses
    curves = ((here, "this campaign", FITTED, "solid"), (there, comparison.campaign, OTHER, "dash"))
    for response, name, colour, dash in curves:
        y = np.abs(response.h1) * np.where(response.known, 1.0, np.nan)
        line = {"color": colour, "width": 1.6, "dash": dash}
        figure.add_scatter(x=response.frequency, y=y, name=name, line=line)
    for peak in comparison.peaks:
        figure.add_vline(x=peak.frequency_hz, line={"color": SOFT, "dash": "dot"})
    figure.update_yaxes(title_text=f"{labels.channel(here.channel).label} per N·m", type="log", dtick="D2")
    figure.update_xaxes(title_text="frequency [Hz]")
    return figure


def backbone(curve: Backbone) -> Figure:
    """Returns the backbone curve: amplitude over frequency of the first resonance."""
    figure = _figure(360)
    shown = labels.channel(curve.channel)
    f = np.array([e.value for e in curve.frequency])
    bars = {"type": "data", "array": [TWO_SIDED_95 * e.standard_error for e in curve.frequency]}
    points = {"x": f, "y": shown.factor * curve.amplitude, "error_x": bars, "marker": _dot(MEASURED)}
    figure.add_scatter(mode="markers", name="sweep", **points)
    a = np.linspace(0, curve.amplitude[-1], 60)
    fitted = curve.small_amplitude.value * (1 + curve.slope.value * (a / curve.amplitude[-1]) ** 2)
    figure.add_scatter(x=fitted, y=shown.factor * a, mode="lines", name="backbone", line={"color": FITTED})
    figure.update_xaxes(title_text="frequency of the resonance [Hz]")
    figure.update_yaxes(title_text=f"amplitude of {shown.label} [{shown.unit}]")
    return figure


def correlation(joint: JointEstimate) -> Figure:
    """Returns the correlations of the joint estimate: their size as that of circles, negative ones hollow."""
    figure = _figure(90 + 30 * len(joint.names))
    names = [labels.parameter(name) for name in joint.names]
    rows, columns = np.nonzero(np.tril(np.ones_like(joint.correlation), -1))
    r = joint.correlation[rows, columns]
    for sign, colour, symbol in ((1, FITTED, "circle"), (-1, OTHER, "circle-open")):
        mine = sign * r > 0
        x, y = ([names[i] for i in index[mine]] for index in (columns, rows))
        marker = {"color": colour, "symbol": symbol, "size": _circle(np.abs(r[mine]))}
        name = "positive" if sign > 0 else "negative"
        hover = "%{y}, %{x}: %{text}<extra></extra>"
        text = [labels.signed(value, 2) for value in r[mine]]
        points = {"mode": "markers", "text": text, "hovertemplate": hover, "showlegend": False}
        figure.add_scatter(x=x, y=y, marker=marker, **points)
        _legend_circle(figure, name, _dot(colour, symbol) | {"size": _circle(0.5)})
    for size in (1.0, 0.5, 0.1):
        _legend_circle(figure, f"{size:g}", {"color": SOFT, "size": _circle(size)})
    figure.update_xaxes(categoryorder="array", categoryarray=names[:-1])
    figure.update_yaxes(categoryorder="array", categoryarray=names[:0:-1])
    return figure.update_layout(margin={"l": 118, "b": 100})


def _circle(size: float | np.ndarray) -> float | np.ndarray:
    """Diameter of the circle of a correlation [px]; its area is proportional to the size."""
    return _LARGEST_CIRCLE * np.sqrt(size)


def _legend_circle(figure: Figure, name: str, marker: dict) -> None:
    """Adds a circle to the legend alone."""
    figure.add_scatter(x=[None], y=[None], mode="markers", name=name, marker=marker, hoverinfo="skip")


def moves(parameters: Mapping[str, Identified]) -> Figure | None:
    """Returns how far each parameter is from its declared value, with its interval; None for fewer than two."""
    known = {name: p for name, p in parameters.items() if p.declared_error}
    if len(known) < 2:
        return None
    figure = _figure(90 + 26 * len(known))
    names = [labels.parameter(name) for name in known]
    scales = np.array([p.declared_error for p in known.values() if p.declared_error])
    values = np.array([p.value for p in known.values()])
    x = (values - [p.declared for p in known.values()]) / scales
    below, above = np.abs(np.array([p.estimate.interval for p in known.values()]).T - values) / scales
    bars = {"type": "data", "array": above, "arrayminus": below}
    hover = "%{y}: %{x:+.2f} declared standard deviations<extra></extra>"
    points = {"marker": _dot(FITTED), "error_x": bars, "hovertemplate": hover, "showlegend": False}
    figure.add_scatter(x=x, y=names, mode="markers", **points)
    figure.add_vrect(x0=-2, x1=2, fillcolor="#e3efe6", line_width=0, layer="below")
    figure.add_vline(x=0, line={"color": SOFT, "width": 1})
    # The shaded range has an end on both sides, and so has every interval that is not withheld (NaN).
    ends = np.abs(x) + np.nan_to_num(np.maximum(below, above))
    reach = max(2.6, 1.1 * float(ends.max()))
    figure.update_xaxes(title_text="declared standard deviations", range=[-reach, reach])
    figure.update_yaxes(autorange="reversed")
    return figure.update_layout(margin={"l": 140})


def _dot(colour: str, symbol: str = "circle") -> dict:
    return {"color": colour, "size": 8, "symbol": symbol}


def _figure(height: int) -> Figure:
    import plotly.graph_objects as go

    return _styled(go.Figure(), height)


def _styled(figure: Figure, height: int) -> Figure:
    return pages.styled(figure, height, {"l": 70, "r": 12, "t": 40, "b": 46})
