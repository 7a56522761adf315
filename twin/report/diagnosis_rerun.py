"""A diagnosis as a rerun recording: the measured arm and those of the declared and the final model, animated together.

Every file of the campaign has a tab with a time axis of its own, the held-out ones first. The shape of the link follows
from hub angle and strains alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin import labels
from twin.diagnosis.answer import LONGEST_GAP, Diagnosis, Prediction, Trace
from twin.recording import HUB_TORQUE, Recording, Sensor
from twin.report import display
from twin.report import rerun_parts as parts
from twin.report.prose import prose

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

# Visible on dark and light backgrounds; measured is a neutral grey, the models differ for all kinds of colour vision.
COLOURS: Mapping[str, tuple[int, int, int]] = {
    "measured": (165, 172, 180),
    "before": (230, 112, 30),
    "after": (60, 150, 220),
    "unmodelled": (214, 90, 160),
    "command": (130, 140, 150),
}

# Plots draw entities in the order of their names: simulated over measured.
_ENTITY_NAMES = {"measured": "measured", "before": "simulated/before", "after": "simulated/after"}
_FIRST_ROW = 1.8  # height of the first row of plots, over that of another [1]
_POINT = 1.5  # radius of the point of a sample [px]
_LEVER = 0.35  # distance of the torque arrow from the hub, over the length of the link [1]
_ARROW = 0.5  # length of the arrow of the largest unmodelled torque, over the length of the link [1]


def to_rrd(diagnosis: Diagnosis, sensors: Mapping[str, Sensor] | None = None) -> bytes:
    """Returns a diagnosis as the content of a file for the rerun viewer (`rerun FILE`), with its layout.

    Args:
      diagnosis: what is shown.
      sensors: channel -> sensor, with the positions of the gauges; without any the links are drawn straight.
    """
    import rerun as rr  # 0.4 s

    shown = [_RecordingView(diagnosis, file, root, sensors or {}) for file, root in _entities(diagnosis)]
    summary = _summary(diagnosis)
    content = [summary, *(part for entry in shown for part in entry.content())]
    with parts.in_memory(diagnosis.campaign, content) as (stream, storage):
        stream.send_blueprint(_blueprint(diagnosis, shown))
        stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)
        for entry in shown:
            _send_recording(stream, entry)
        return storage.drain_as_bytes()


def _entities(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    """Yields file and entity path of each recording, held-out ones first."""
    numbers = count(1)
    for role in ("holdout", "fit"):
        for file in display.by_role(diagnosis, role):
            yield file, f"/{role}/{next(numbers):02}_{parts.entity_name(Path(file).stem)}"


# One recording


@dataclass(frozen=True)
class _RecordingView:
    """One recording of a diagnosis in the viewer.

    Attributes:
      diagnosis: the whole diagnosis.
      file: of the recording.
      root: its entity path.
      sensors: channel -> sensor.
    """

    diagnosis: Diagnosis
    file: str
    root: str
    sensors: Mapping[str, Sensor]

    @property
    def prediction(self) -> Prediction:
        return self.diagnosis.predictions[self.file]

    @property
    def length(self) -> float:
        return self.diagnosis.declared["length"]

    def models(self) -> dict[str, Recording]:
        """The three arms by name."""
        p = self.prediction
        return {"measured": p.measured, "before": p.before, "after": p.after}

    def content(self) -> Iterator[str | np.ndarray]:
        """All that tells this recording from another."""
        yield self.file
        for recording in self.models().values():
            yield from parts.content_of(recording.time, recording.channels)

    def channels(self) -> list[str]:
        """Measured channels that the models predict."""
        return [name for name in self.prediction.measured.measured() if name in self.prediction.after]

    def torque(self) -> tuple[Trace, np.ndarray, np.ndarray] | None:
        """The trace of the unmodelled hub torque with its samples here and their times [s]; None without one."""
        unseen = self.prediction.torque
        if unseen is not None:
            samples = np.flatnonzero(np.isfinite(unseen.values))
            return unseen, samples, self.prediction.measured.time[0] + np.asarray(unseen.since_start)[samples]
        for trace in self.diagnosis.traces:
            if trace.channel == HUB_TORQUE:
                samples, time = _trace_samples(self.diagnosis, trace, self.file)
                return (trace, samples, time) if len(samples) else None
        return None


def _trace_samples(diagnosis: Diagnosis, trace: Trace, file: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the indices of a trace's samples in a file, and their times on the clock of the file [s].

    A trace numbers the fit recordings in their order.
    """
    files = list(display.by_role(diagnosis, "fit"))
    if file not in files:
        return np.array([], dtype=int), np.array([])
    mine = (np.asarray(trace.recording) == files.index(file)) & np.isfinite(trace.values)
    samples = np.flatnonzero(mine)
    return samples, diagnosis.predictions[file].measured.time[0] + np.asarray(trace.since_start)[samples]


def _send_recording(stream: rr.RecordingStream, entry: _RecordingView) -> None:
    parts.send_scenery(stream, entry.root, entry.length)
    measured = entry.prediction.measured
    frames = np.arange(measured.time[0], measured.time[-1] + 0.5 / parts.FRAME_RATE, 1 / parts.FRAME_RATE)
    for level, (model, recording) in enumerate(entry.models().items()):
        line = parts.centre_line(recording, frames, entry.length, entry.sensors)
        thick = (0.016 if model == "measured" else 0.009) * entry.length
        place = f"{entry.root}/arms/{_ENTITY_NAMES[model]}"
        whole = parts.raised(line, level, entry.length)
        parts.send_arm(stream, place, frames, whole, COLOURS[model], thick)
        for name in entry.channels():
            if name in recording:
                values = labels.channel(name).factor * entry.prediction.reading(model, name)
                entity = f"{entry.root}/{name}/{_ENTITY_NAMES[model]}"
                _send_scalars(stream, entity, recording.time, values, model)
                if model != "measured":
                    left = labels.channel(name).factor * entry.prediction.residual(model, name)
                    _send_scalars(
                        stream, f"{entry.root}/residuals/{name}/{model}", recording.time, left, model
                    )
    if "torque_command" in measured:
        command = measured["torque_command"]
        _send_scalars(stream, f"{entry.root}/torque/command", measured.time, command, "command")
    _send_torque(stream, entry, frames)


def _send_scalars(
    stream: rr.RecordingStream, entity: str, time: np.ndarray, values: np.ndarray, model: str, name: str = ""
) -> None:
    width = {"measured": 4.0, "command": 1.0, "unmodelled": 1.0}.get(model, 1.5)
    parts.send_scalars(stream, entity, time, values, COLOURS[model], name or model, width)


def _send_points(
    stream: rr.RecordingStream, entity: str, time: np.ndarray, values: np.ndarray, colour: str, name: str
) -> None:
    """Sends points over time: a line would go on where there is no sample."""
    import rerun as rr

    style = rr.SeriesPoints(colors=COLOURS[colour], names=name, markers="circle", marker_sizes=_POINT)
    stream.log(entity, style, static=True)
    index = rr.TimeColumn(parts.TIMELINE, duration=time)
    stream.send_columns(entity, [index], rr.Scalars.columns(scalars=values))


def _send_torque(stream: rr.RecordingStream, entry: _RecordingView, frames: np.ndarray) -> None:
    """Sends the torque that the model lacks, as a line over time and as an arrow at the measured arm."""
    import rerun as rr

    torque_trace = entry.torque()
    if torque_trace is None:
        return
    trace, samples, time = torque_trace
    values = np.asarray(trace.values)[samples]
    _send_points(stream, f"{entry.root}/unmodelled/estimated", time, values, "unmodelled", "estimated")
    pushing = values
    if trace.fitted is not None:
        pushing = np.asarray(trace.fitted)[samples]
        _send_points(stream, f"{entry.root}/unmodelled/fitted", time, pushing, "after", "effects found")
    there = np.isfinite(pushing)
    if not _has_arrow(entry.diagnosis) or not there.any():
        return
    known = _between_close_samples(frames, time[there])
    torque = np.interp(frames[known], time[there], pushing[there])
    origins, vectors = _arrows(entry, frames[known], torque / max(np.abs(pushing[there]).max(), 1e-12))
    entity = f"{entry.root}/arms/unmodelled_torque"
    style = rr.Arrows3D.from_fields(colors=COLOURS["unmodelled"], radii=0.012 * entry.length)
    stream.log(entity, style, static=True)
    # No arrow where no torque is known.
    columns = rr.Arrows3D.columns(origins=origins, vectors=vectors).partition(known.astype(int))
    stream.send_columns(entity, [rr.TimeColumn(parts.TIMELINE, duration=frames)], columns)


def _has_arrow(diagnosis: Diagnosis) -> bool:
    """Whether the unmodelled torque is shown as an arrow: where nothing is missing it is noise."""
    return bool(diagnosis.traces) and diagnosis.verdict != "no-missing-effect"


def _between_close_samples(instants: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Whether instants (k) [s] lie between two samples, at times (n) [s], that are at most `LONGEST_GAP` apart."""
    behind = np.searchsorted(time, instants, side="right")
    last, next_one = time[np.clip(behind - 1, 0, None)], time[np.clip(behind, None, len(time) - 1)]
    return (last <= instants) & (instants <= next_one) & (next_one - last <= LONGEST_GAP)


def _arrows(entry: _RecordingView, frames: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns origins and vectors (k x 3) of the arrow [m], for torques as a share (k) of the largest one."""
    theta = parts.interpolated(entry.prediction.measured, "hub_angle", frames)
    along = np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    across = np.stack([-np.sin(theta), np.cos(theta), 0 * theta], axis=1)
    origins = _LEVER * entry.length * along + [0, 0, 0.06 * entry.length]
    return origins, _ARROW * entry.length * share[:, None] * across


# Layout and text


def _blueprint(diagnosis: Diagnosis, shown: Sequence[_RecordingView]) -> rrb.Blueprint:
    import rerun.blueprint as rrb

    tabs: list[Any] = []
    for role, name in (("holdout", "held out"), ("fit", "fit")):
        mine = [_tab(diagnosis, entry) for entry in shown if entry.prediction.role == role]
        if mine:
            tabs.append(rrb.Tabs(*mine, name=f"{name} ({len(mine)})", active_tab=0))
    tabs.append(rrb.TextDocumentView(origin="/summary", name="summary"))
    return parts.blueprint(rrb.Tabs(*tabs, active_tab=0))


def _tab(diagnosis: Diagnosis, entry: _RecordingView) -> rrb.Horizontal:
    import rerun.blueprint as rrb

    arms = parts.arms_view(entry.root, entry.length)
    left = rrb.Vertical(arms, rrb.TextDocumentView(origin="/summary", name="summary"), row_shares=[3, 2])
    rows = list(_plots(entry))
    # Axes of low plots have a single tick: the first channel is the one to read.
    plots = rrb.Vertical(*rows, row_shares=[_FIRST_ROW, *[1.0] * (len(rows) - 1)][: len(rows)])
    return rrb.Horizontal(left, plots, column_shares=[1, 3], name=entry.file)


def _plots(entry: _RecordingView) -> Iterator[Any]:
    """Rows of plots over one time window: each channel beside what is left of it, the torques below."""
    import rerun.blueprint as rrb

    measured = entry.prediction.measured
    window = (float(measured.time[0]), float(measured.time[-1]))
    for name in entry.channels():
        left_of = f"{labels.channel(name).label}: measured − simulated [{labels.channel(name).unit}]"
        yield rrb.Horizontal(
            parts.channel_view(f"{entry.root}/{name}", name, window=window),
            parts.series_view(f"{entry.root}/residuals/{name}", left_of, window),
        )
    torques = []
    if "torque_command" in measured:
        torques.append(parts.series_view(f"{entry.root}/torque", "commanded torque [N·m]", window))
    if entry.torque():
        shown = labels.unmodelled(HUB_TORQUE)
        torques.append(parts.series_view(f"{entry.root}/unmodelled", f"{shown.label} [{shown.unit}]", window))
    if torques:
        yield rrb.Horizontal(*torques)


def _summary(diagnosis: Diagnosis) -> str:
    """Returns verdict, effects and next experiment as markdown."""
    arrow = (
        " The **pink** arrow is the torque that the model lacks, where it can be estimated: while the hub slides."
        if _has_arrow(diagnosis)
        else ""
    )
    lines = [
        f"## {display.headline(diagnosis)}",
        f"**Grey** measured, **orange** the declared model, **blue** the final one.{arrow}",
        display.unknown_zeros(diagnosis),
        display.caveat(diagnosis),
        prose(diagnosis.summary),
        display.improvement(diagnosis),
    ]
    for effect in diagnosis.effects:
        values = ", ".join(
            f"{labels.words(name)} {value} {unit}".strip()
            for name, value, unit, _ in display.parameter_rows(effect)
        )
        lines.append(f"**{labels.words(effect.name)}**: {values}")
    if diagnosis.next_experiment:
        lines.append(f"Next: {prose(diagnosis.next_experiment)}")
    return "\n\n".join(line for line in lines if line)
