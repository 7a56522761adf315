"""The recordings of a campaign as they were read: every channel over time, with rests and saturation marked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.proposal import motions
from twin.recording import CHANNEL_UNITS, Recording
from twin.report import pages
from twin.report.decimate import as_axis, decimate
from twin.report.pages import Figure
from twin.report.panels import Panels, title

_ROW = 122  # height of a panel [px]
_POINTS = 1200  # of a line
_SHADE = "#e4e8ec"  # of a rest


@dataclass(frozen=True)
class ReadRecording:
    """A recording, and what was seen in it.

    Attributes:
      recording: SI.
      role: "fit" or "holdout".
      rests: (begin, end) of each rest of the hub [s].
      limit: of the command [N m]; infinite where none is declared.
    """

    recording: Recording
    role: str
    rests: tuple[tuple[float, float], ...] = ()
    limit: float = np.inf


def read_recordings(campaign: Campaign) -> tuple[ReadRecording, ...]:
    """Returns the recordings of a campaign, those that are fitted first."""
    limit = campaign.rig["torque_limit"]
    roles = (*((r, "fit") for r in campaign.fit), *((r, "holdout") for r in campaign.holdout()))
    return tuple(ReadRecording(r, role, motions.rest_spans(campaign, r), limit) for r, role in roles)


def caption(read: ReadRecording) -> str:
    """Returns role, length, hub and start of a recording, in a line."""
    recording = read.recording
    role = "fitted" if read.role == "fit" else "held out"
    hub = "hub locked" if recording.clamped else "hub free"
    start = "at rest at first" if recording.start == "rest" else "may move at first"
    loop = "command of a controller" if recording.loop == "closed" else "prescribed command"
    return f"{role}, {labels.number(recording.duration, 3)} s, {hub}, {start}, {loop}"


def figure(read: ReadRecording) -> Figure:
    """Returns a panel over time for each channel, in its displayed unit."""
    recording = read.recording
    names = [name for name in CHANNEL_UNITS if name in recording and np.isfinite(recording[name]).any()]
    page = Panels([1.0] * len(names), row=_ROW, columns=(1.0,))
    for row, name in enumerate(names):
        shown = labels.channel(name)
        values = shown.factor * recording[name]
        kept = decimate(values, _POINTS)
        page.add(
            row,
            0,
            x=as_axis(recording.time[kept]),
            y=values[kept].astype("f4"),
            mode="lines",
            line={"color": pages.BLUE, "width": 1.2},
            showlegend=False,
            hovertemplate=f"{shown.label}: %{{y:.4g}} {shown.unit}<br>%{{x:.3f}} s<extra></extra>",
        )
        page.set(page.axes(row, 0)[1], title=_title(shown), nticks=4)
        if name == "torque_command":
            _mark_saturation(page, row, read)
    _mark_rests(page, len(names), read)
    page.time_below(0, len(names))
    return page.figure()


def _title(shown: labels.Display) -> dict[str, Any]:
    """The title of an axis in two lines, as high as a panel."""
    one_line = title(shown.label, shown.unit)
    return one_line | {"text": one_line["text"].replace(" [", "<br>[")}


def _mark_saturation(page: Panels, row: int, read: ReadRecording) -> None:
    """Marks the samples whose command is at the limit of the amplifier or beyond."""
    command = read.recording["torque_command"]
    at = np.flatnonzero(np.abs(command) >= read.limit)
    if not at.size:
        return
    at = at[np.linspace(0, at.size - 1, min(at.size, _POINTS)).astype(int)]
    marker = {"color": pages.VERMILION, "size": 5, "symbol": "circle-open"}
    page.add(
        row,
        0,
        x=as_axis(read.recording.time[at]),
        y=command[at].astype("f4"),
        mode="markers",
        marker=marker,
        name="at the limit of the amplifier",
        hoverinfo="skip",
    )


def _mark_rests(page: Panels, rows: int, read: ReadRecording) -> None:
    """Shades the rests of the hub in all panels."""
    for begin, end in read.rests:
        for row in range(rows):
            x, y = page.axes(row, 0)
            place = {"xref": x, "yref": f"{y} domain", "x0": begin, "x1": end, "y0": 0, "y1": 1}
            look = {"type": "rect", "fillcolor": _SHADE, "line": {"width": 0}, "layer": "below"}
            page.layout["shapes"].append(place | look)
    if read.rests:
        marker = {"color": _SHADE, "size": 12, "symbol": "square"}
        page.add(0, 0, x=[None], y=[None], mode="markers", marker=marker, name="the hub rests")


def shown(reads: tuple[ReadRecording, ...]) -> Iterator[tuple[str, str, Figure]]:
    """Yields name, caption and figure of each recording."""
    for read in reads:
        yield read.recording.name, caption(read), figure(read)
