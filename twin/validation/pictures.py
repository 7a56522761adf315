"""Plotly figures of a validation: the runs of all rigs, and histograms of the metrics with their limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from twin import labels
from twin.report import pages
from twin.report.decimate import decimate
from twin.validation import text
from twin.validation.fleet import Outcome
from twin.validation.validation import Validation, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEETS_ALL, VIOLATES, NOMINAL = pages.GREY, pages.VERMILION, pages.BLUE
_CHANNELS: Mapping[str, tuple[str, float]] = {
    "hub_angle": ("hub angle [°]", float(np.degrees(1))),
    "tip_deflection": ("tip deflection [mm]", 1e3),
    "motor_torque": ("motor torque [N·m]", 1.0),
}
_BINS = 30  # of a histogram, at most
_MOST_NUMBERS = 240_000
"""In the figure of the runs, 5.3 bytes each, so that the page stays below 4 MB."""


def runs(result: Validation) -> Figure:
    """Returns hub angle, deflection and torque of every rig over time."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=len(_CHANNELS), shared_xaxes=True, vertical_spacing=0.05)
    kept = [o for o in result.outcomes if result.keeps(o)]
    missed = [o for o in result.outcomes if not result.keeps(o)]
    groups = (
        ("keeps every limit", MEETS_ALL, 0.8, "solid", kept),
        ("misses a limit", VIOLATES, 1.2, "dash", missed),
        ("nominal", NOMINAL, 2.4, "solid", [result.nominal]),
    )
    for row, (channel, (label, scale)) in enumerate(_CHANNELS.items(), 1):
        for name, colour, width, dash, outcomes in groups:
            if outcomes:
                x, y = _joined_lines(outcomes, channel, scale)
                line = {"color": colour, "width": width, "dash": dash}
                group = {"name": name, "legendgroup": name, "showlegend": row == 1}
                figure.add_scatter(
                    x=x, y=y, mode="lines", line=line, hoverinfo="skip", row=row, col=1, **group
                )
        figure.update_yaxes(title_text=label, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(_CHANNELS), col=1)
    return _styled(figure, 640)


def spreads(result: Validation, columns: int) -> Figure | None:
    """Returns a histogram of each metric that differs between rigs, with its limit; None where none does."""
    from plotly.subplots import make_subplots

    shown = [v for v in result.verdicts if _varies(v)]
    if not shown:
        return None
    rows = -(-len(shown) // columns)
    titles = [_title(v) for v in shown]
    figure = make_subplots(rows=rows, cols=columns, subplot_titles=titles, vertical_spacing=0.24 / rows**0.5)
    for index, v in enumerate(shown):
        place = {"row": index // columns + 1, "col": index % columns + 1}
        values = v.values[np.isfinite(v.values)]
        counts, edges = np.histogram(values, bins=min(_BINS, max(len(values) // 4, 4)))
        bars = {"x": (edges[:-1] + edges[1:]) / 2, "y": counts, "width": np.diff(edges)}
        marker = {"color": MEETS_ALL, "line": {"width": 0}}
        figure.add_bar(**bars, marker=marker, showlegend=False, **place)
        if np.isfinite(v.nominal):
            figure.add_vline(x=v.nominal, line={"color": NOMINAL, "width": 2}, **place)
        limit = v.requirement.limit
        # A distant limit would compress the histogram: it is left out.
        if min(values) - np.ptp(values) <= limit <= max(values) + np.ptp(values):
            figure.add_vline(x=limit, line={"color": VIOLATES, "width": 2, "dash": "dash"}, **place)
    return _styled(figure, 60 + 190 * rows)


def _title(verdict: Verdict) -> str:
    """Name and unit; for a narrow column in two lines."""
    unit = "" if verdict.requirement.unit == "1" else f" [{labels.unit(verdict.requirement.unit)}]"
    return f"{verdict.requirement.name.replace('_', ' ')}{unit}"


def _varies(verdict: Verdict) -> bool:
    """Whether the metric differs between rigs in the digits that are printed."""
    finite = verdict.values[np.isfinite(verdict.values)]
    return len(finite) > 1 and text.number(finite.min()) != text.number(finite.max())


def _joined_lines(outcomes: Sequence[Outcome], channel: str, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """x and y of one line through a channel of all outcomes, with a gap after each; `scale` from SI."""
    points = max(_MOST_NUMBERS // (2 * len(_CHANNELS) * len(outcomes)), 30)
    x, y = [], []
    for outcome in outcomes:
        kept = decimate(outcome.traces[channel], points)
        x += [outcome.time[kept], [np.nan]]
        y += [scale * outcome.traces[channel][kept], [np.nan]]
    return np.concatenate(x).astype("f4"), np.concatenate(y).astype("f4")


def _styled(figure: Figure, height: int) -> Figure:
    pages.styled(figure, height, {"l": 62, "r": 12, "t": 52, "b": 46})
    return figure.update_layout(bargap=0.02).update_annotations(font_size=13)
