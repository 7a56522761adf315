"""Plotly figures of an identification, one for each procedure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from twin import labels
from twin.identification.backbone import Backbone
from twin.identification.balance import Balance
from twin.identification.break_away import StaticFriction
from twin.identification.compare_campaigns import Comparison
from twin.identification.decay import Decay
from twin.identification.estimates import TWO_SIDED_95
from twin.identification.friction_map import FrictionMap
from twin.identification.joint import Joint
from twin.identification.spectra import Response, peaks
from twin.identification.static_line import LoadLine
from twin.report import pages
from twin.report.decimate import thin

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEASURED, FITTED, OTHER, SOFT = pages.INK, pages.BLUE, pages.VERMILION, pages.GREY
_POINTS = 2000


def load_line(line: LoadLine, column: str) -> Figure:
    """The static test: displacement over load, with its line."""
    figure = _figure(360)
    x = np.array([min(0.0, line.x.min()), line.x.max()])
    y = line.intercept.value + line.slope.value * x
    figure.add_scatter(x=line.x, y=1e3 * line.y, mode="markers", name="measured", marker=_dot(MEASURED))
    figure.add_scatter(x=x, y=1e3 * y, mode="lines", name="line", line={"color": FITTED})
    figure.update_xaxes(title_text="load [N]" if column.startswith("tip_") else column)
    figure.update_yaxes(title_text="tip displacement [mm]")
    return figure


def decay(found: Decay) -> Figure:
    """A ring-down with the envelope of its losses."""
    shown = labels.channel(found.channel)
    figure = _figure(380)
    kept = thin(len(found.time), _POINTS)
    line = {"color": SOFT, "width": 1}
    figure.add_scatter(x=found.time[kept], y=shown.factor * found.values[kept], name="measured", line=line)
    envelope = _envelope(found)
    for sign in (1, -1):
        style = {"color": FITTED, "width": 2}
        y = sign * shown.factor * envelope
        figure.add_scatter(
            x=found.middle, y=y, mode="lines", name="envelope", line=style, showlegend=sign > 0
        )
    bars = {"type": "data", "array": shown.factor * found.amplitude_error}
    points = {
        "x": found.middle,
        "y": shown.factor * found.amplitude,
        "error_y": bars,
        "marker": _dot(MEASURED),
    }
    figure.add_scatter(mode="markers", name="amplitude of a period", **points)
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text=f"{shown.label} [{shown.unit}]")
    return figure


def _envelope(found: Decay) -> np.ndarray:
    """Amplitude (m) that the losses give, from the first one on."""
    values = [found.amplitude[0]]
    powers = np.arange(3)
    for step in np.diff(found.middle):
        a = values[-1]
        for _ in range(50):
            a = max(a - step / 50 * float(found.losses @ a**powers), 0.0)
        values.append(a)
    return np.array(values)


def break_aways(found: StaticFriction) -> Figure:
    """Break-away torque over the angle at which it was read."""
    figure = _figure(340)
    for direction, colour, name in ((1, FITTED, "towards positive"), (-1, OTHER, "towards negative")):
        mine = [(e, s) for e, s in zip(found.events, found.errors, strict=True) if e.direction == direction]
        if mine:
            bars = {"type": "data", "array": [TWO_SIDED_95 * s for _, s in mine]}
            x, y = [np.degrees(e.angle) for e, _ in mine], [abs(e.torque) for e, _ in mine]
            figure.add_scatter(x=x, y=y, error_y=bars, mode="markers", name=name, marker=_dot(colour))
    figure.update_xaxes(title_text="hub angle [°]")
    # From zero: a spread of percents is not to look like one of halves.
    figure.update_yaxes(title_text="torque at break-away [N m]", rangemode="tozero")
    return figure


def friction(hub: Balance) -> Figure:
    """Torque that the hub's balance leaves for friction, over the rate of the hub: the friction map."""
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
    figure.update_yaxes(title_text="friction torque [mN m]")
    return figure


def friction_map(found: FrictionMap) -> Figure:
    """Equivalent damping of the unclamped decay over the Coulomb friction that was simulated, and the measured one."""
    figure = _figure(360)
    x, y = 1e3 * found.coulomb, 100 * found.damping
    figure.add_scatter(x=x, y=y, mode="lines+markers", name="simulated", line={"color": FITTED})
    figure.add_hline(y=100 * found.measured.value, line={"color": MEASURED, "dash": "dot"})
    if found.level is not None:
        bars = {"type": "data", "array": [1e3 * TWO_SIDED_95 * found.level.standard_error]}
        point = {"x": [1e3 * found.level.value], "y": [100 * found.measured.value], "error_x": bars}
        figure.add_scatter(mode="markers", name="measured", marker=_dot(MEASURED), **point)
    figure.update_xaxes(title_text="Coulomb friction [mN m]")
    figure.update_yaxes(title_text="equivalent damping ratio [%]")
    return figure


def response(found: Response) -> Figure:
    """The frequency response by three estimators, and the coherence below."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=[0.7, 0.3], vertical_spacing=0.06)
    shown = np.where(found.known, 1.0, np.nan)
    curves = ((found.estimator, found.h1, FITTED), ("H2", found.h2, OTHER), ("Hv", found.hv, SOFT))
    for name, values, colour in curves:
        y = np.abs(values) * shown
        figure.add_scatter(
            x=found.frequency, y=y, name=name, line={"color": colour, "width": 1.6}, row=1, col=1
        )
    for peak in peaks(found):
        figure.add_vline(x=peak.frequency.value, line={"color": SOFT, "dash": "dot"}, row=1, col=1)
    line = {"color": MEASURED, "width": 1.2}
    figure.add_scatter(x=found.frequency, y=found.coherence, line=line, showlegend=False, row=2, col=1)
    figure.update_yaxes(title_text=f"{labels.channel(found.channel).label} per N m", type="log", row=1, col=1)
    figure.update_yaxes(title_text="coherence", range=[0, 1.02], row=2, col=1)
    figure.update_xaxes(title_text="frequency [Hz]", row=2, col=1)
    return _styled(figure, 520)


def beside(found: Comparison) -> Figure:
    """The responses of two campaigns of one rig."""
    figure = _figure(380)
    here, there = found.responses
    for response, name, colour in ((here, "this campaign", FITTED), (there, found.campaign, OTHER)):
        y = np.abs(response.h1) * np.where(response.known, 1.0, np.nan)
        figure.add_scatter(x=response.frequency, y=y, name=name, line={"color": colour, "width": 1.6})
    for peak in found.peaks:
        figure.add_vline(x=peak.frequency_hz, line={"color": SOFT, "dash": "dot"})
    figure.update_yaxes(title_text=f"{labels.channel(here.channel).label} per N m", type="log")
    figure.update_xaxes(title_text="frequency [Hz]")
    return figure


def backbone(found: Backbone) -> Figure:
    """Frequency of the first resonance over its amplitude."""
    figure = _figure(360)
    shown = labels.channel(found.channel)
    f = np.array([e.value for e in found.frequency])
    bars = {"type": "data", "array": [TWO_SIDED_95 * e.standard_error for e in found.frequency]}
    points = {"x": f, "y": shown.factor * found.amplitude, "error_x": bars, "marker": _dot(MEASURED)}
    figure.add_scatter(mode="markers", name="sweep", **points)
    a = np.linspace(0, found.amplitude[-1], 60)
    curve = found.small.value * (1 + found.slope.value * (a / found.amplitude[-1]) ** 2)
    figure.add_scatter(x=curve, y=shown.factor * a, mode="lines", name="backbone", line={"color": FITTED})
    figure.update_xaxes(title_text="frequency of the resonance [Hz]")
    figure.update_yaxes(title_text=f"amplitude of {shown.label} [{shown.unit}]")
    return figure


def correlation(found: Joint) -> Figure:
    """What moves together in the joint estimate."""
    figure = _figure(460)
    names = [labels.words(name) for name in found.names]
    r = found.correlation.round(2)
    figure.add_heatmap(
        z=r, x=names, y=names, text=r, texttemplate="%{text}", colorscale="RdBu", zmin=-1, zmax=1, zmid=0
    )
    figure.update_yaxes(autorange="reversed")
    figure.update_layout(margin={"l": 140, "b": 110})
    return figure


def _dot(colour: str) -> dict:
    return {"color": colour, "size": 8}


def _figure(height: int) -> Figure:
    import plotly.graph_objects as go

    return _styled(go.Figure(), height)


def _styled(figure: Figure, height: int) -> Figure:
    return pages.styled(figure, height, {"l": 70, "r": 12, "t": 40, "b": 46})
