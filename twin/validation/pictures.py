"""Plotly figures of a validation: the runs of all rigs, and histograms of the metrics with their limits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from twin.report import pages
from twin.validation import text
from twin.validation.fleet import Outcome
from twin.validation.validation import Validation, Verdict

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MEETS_ALL, VIOLATES, NOMINAL = pages.GREY, pages.VERMILION, pages.BLUE
_CHANNELS: Mapping[str, tuple[str, float]] = {
    "hub_angle": ("hub angle [°]", float(np.degrees(1))),
    "tip_deflection": ("tip deflection [mm]", 1e3),
    "motor_torque": ("motor torque [N m]", 1.0),
}
_COLUMNS = 4  # of histograms


def runs(result: Validation) -> Figure:
    """Returns hub angle, deflection and torque of every rig over time."""
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=len(_CHANNELS), shared_xaxes=True, vertical_spacing=0.05)
    kept = [o for o in result.outcomes if result.keeps(o)]
    missed = [o for o in result.outcomes if not result.keeps(o)]
    groups = (
        ("keeps every limit", MEETS_ALL, 0.8, kept),
        ("misses a limit", VIOLATES, 1.2, missed),
        ("nominal", NOMINAL, 2.2, [result.nominal]),
    )
    for row, (channel, (label, scale)) in enumerate(_CHANNELS.items(), 1):
        for name, colour, width, outcomes in groups:
            if outcomes:
                x, y = _joined_lines(outcomes, channel, scale)
                line = {"color": colour, "width": width}
                group = {"name": name, "legendgroup": name, "showlegend": row == 1}
                figure.add_scatter(
                    x=x, y=y, mode="lines", line=line, hoverinfo="skip", row=row, col=1, **group
                )
        figure.update_yaxes(title_text=label, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(_CHANNELS), col=1)
    return _styled(figure, 640)


def spreads(result: Validation) -> Figure | None:
    """Returns a histogram of each metric that differs between rigs, with its limit; None where none does."""
    from plotly.subplots import make_subplots

    shown = [v for v in result.verdicts if _varies(v)]
    if not shown:
        return None
    rows = -(-len(shown) // _COLUMNS)
    titles = [f"{v.requirement.name.replace('_', ' ')} [{v.requirement.unit}]" for v in shown]
    figure = make_subplots(rows=rows, cols=_COLUMNS, subplot_titles=titles, vertical_spacing=0.24 / rows**0.5)
    for index, v in enumerate(shown):
        place = {"row": index // _COLUMNS + 1, "col": index % _COLUMNS + 1}
        values = v.values[np.isfinite(v.values)].round(6)
        bar = {"color": MEETS_ALL, "line": {"width": 0}}
        figure.add_histogram(x=values, nbinsx=30, marker=bar, showlegend=False, **place)
        figure.add_vline(x=v.nominal, line={"color": NOMINAL, "width": 2}, **place)
        limit = v.requirement.limit
        # A distant limit would compress the histogram: it is left out.
        if min(values) - np.ptp(values) <= limit <= max(values) + np.ptp(values):
            figure.add_vline(x=limit, line={"color": VIOLATES, "width": 2, "dash": "dash"}, **place)
    return _styled(figure, 60 + 190 * rows)


def _varies(verdict: Verdict) -> bool:
    """Whether the metric differs between rigs in the digits that are printed."""
    finite = verdict.values[np.isfinite(verdict.values)]
    return len(finite) > 1 and text.number(finite.min()) != text.number(finite.max())


def _joined_lines(outcomes: Iterable[Outcome], channel: str, scale: float) -> tuple[list, list]:
    """x and y of one line through a channel of all outcomes, with a gap after each; `scale` from SI."""
    x, y = [], []
    for outcome in outcomes:
        x += [*outcome.time.round(4).tolist(), None]
        y += [*(float(f"{value:.4g}") for value in scale * outcome.traces[channel]), None]
    return x, y


def _styled(figure: Figure, height: int) -> Figure:
    pages.styled(figure, height, {"l": 62, "r": 12, "t": 52, "b": 46})
    return figure.update_layout(bargap=0.02).update_annotations(font_size=13)
