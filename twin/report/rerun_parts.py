"""Parts of all rerun recordings of the rig: an arm in 3D, lines over time, and their views."""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from twin import labels
from twin.recording import Recording, Sensor

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

APPLICATION = "flexlink-twin"
"""Name under which the viewer lists all recordings."""
TIMELINE = "sim_time"
"""Name of the time axis in the viewer."""
FRAME_RATE = 60.0
"""Frame rate of the arms [Hz]; scalars keep every sample."""
Colour = tuple[int, int, int]

_LINE_POINTS = 24  # of the line of a link
_GREY = (110, 116, 124)


@contextmanager
def in_memory(
    name: str, content: Iterable[str | np.ndarray]
) -> Iterator[tuple[rr.RecordingStream, rr.MemoryRecording]]:
    """Context of a stream and its storage, whose `drain_as_bytes` is the content of a file.

    The viewer takes files with the same identity for one recording: it is a hash of what is shown, so that another
    run is another recording, and the same run the same one. No time of the wall clock is stored with it.

    Args:
      name: of the recording.
      content: all that is shown.
    """
    import rerun as rr

    digest = hashlib.sha256(name.encode("utf-8", "replace"))
    for part in content:
        digest.update(part.encode("utf-8", "replace") if isinstance(part, str) else part.tobytes())
    with _enabled():
        stream = rr.RecordingStream(
            APPLICATION,
            recording_id=str(uuid.UUID(bytes=digest.digest()[:16])),
            send_properties=False,  # the instant of its making
            # Chunks end where the data do, not after a time that depends on the machine.
            batcher_config=rr.ChunkBatcherConfig.NEVER(),
        )
        storage = stream.memory_recording()
        stream.send_recording_name(name)
        yield stream, storage


@contextmanager
def _enabled() -> Iterator[None]:
    """Hides the environment variable RERUN, by which rerun is switched off and a file would be empty."""
    switch = os.environ.pop("RERUN", None)
    try:
        yield
    finally:
        if switch is not None:
            os.environ["RERUN"] = switch


def content_of(time: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[str | np.ndarray]:
    """Returns instants and channels as a part of the content of a recording."""
    return [time, *(part for name, values in channels.items() for part in (name, values))]


def centre_line(
    recording: Recording, times: np.ndarray, length: float, sensors: Mapping[str, Sensor]
) -> np.ndarray:
    """Returns the centre line of the link from hub angle and strains.

    The curvature kappa = strain / half_thickness at the gauges, interpolated linearly between them and to zero at the
    tip, is integrated twice along the arc:

        phi(s) = theta + int_0^s kappa ds,   x(s) = int_0^s cos(phi) ds,   y(s) = int_0^s sin(phi) ds

    Args:
      recording: measured or simulated; a clamped hub is at zero where its angle was not measured.
      times: (k) instants [s].
      length: of the link [m].
      sensors: channel -> sensor.

    Returns:
      (k x p x 2) x and y of p points from hub to tip [m].
    """
    s = np.linspace(0.0, length, _LINE_POINTS)
    curvature = _curvature(recording, times, s, sensors)
    theta = interpolated(recording, "hub_angle", times)
    heading = theta[:, None] + _integral(curvature, s)
    return np.stack([_integral(np.cos(heading), s), _integral(np.sin(heading), s)], axis=-1)


def _curvature(
    recording: Recording, times: np.ndarray, s: np.ndarray, sensors: Mapping[str, Sensor]
) -> np.ndarray:
    """Returns the curvature (k x p) [1/m]: linear between gauges, extrapolated to the hub, zero at the tip."""
    gauges = sorted(
        (sensor for name, sensor in sensors.items() if name in recording and sensor.half_thickness > 0),
        key=lambda sensor: sensor.position,
    )
    gauges = [sensor for sensor in gauges if sensor.position < s[-1]]
    if not gauges:
        return np.zeros((len(times), len(s)))
    at = np.array([*(sensor.position for sensor in gauges), s[-1]])
    values = [interpolated(recording, sensor.channel, times) / sensor.half_thickness for sensor in gauges]
    known = np.stack([*values, np.zeros(len(times))], axis=1)
    # Interval of each point; before the first gauge the line is extrapolated.
    left = np.clip(np.searchsorted(at, s, side="right") - 1, 0, len(at) - 2)
    weight = (s - at[left]) / (at[left + 1] - at[left])
    return known[:, left] * (1 - weight) + known[:, left + 1] * weight


def interpolated(recording: Recording, channel: str, times: np.ndarray) -> np.ndarray:
    """Returns a channel at other times [s], interpolated over missing samples; zero without any sample."""
    if channel not in recording:
        return np.zeros(len(times))
    there = np.isfinite(recording[channel])
    if not there.any():
        return np.zeros(len(times))
    return np.interp(times, recording.time[there], recording[channel][there])


def _integral(values: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns the integral from the first point to each (k x p), by the trapezoidal rule."""
    steps = 0.5 * (values[:, 1:] + values[:, :-1]) * np.diff(s)
    return np.concatenate([np.zeros((len(values), 1)), np.cumsum(steps, axis=1)], axis=1)


def raised(line: np.ndarray, level: int, length: float) -> np.ndarray:
    """Returns a link's line (k x p x 2) as (k x p x 3) [m], raised by its level, so that no arm hides another."""
    height = np.full((*line.shape[:2], 1), 0.012 * length * level)
    return np.concatenate([line, height], axis=2)


def entity_name(name: str) -> str:
    """Returns a name as a part of the path of an entity; names that differ have parts that differ."""
    import rerun as rr

    # Names of files may have bytes that are no text, which rerun does not take.
    return rr.escape_entity_path_part(name.encode("utf-8", "backslashreplace").decode())


def send_scenery(stream: rr.RecordingStream, root: str, length: float) -> None:
    """Logs the hub, and the circle of the tip of a straight link."""
    import rerun as rr

    stream.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    radius = 0.035 * length
    hub = rr.Cylinders3D(lengths=2 * radius, radii=radius, colors=_GREY, fill_mode="solid")
    stream.log(f"{root}/arms/hub", hub, static=True)
    angles = np.linspace(-np.pi, np.pi, 181)
    circle = length * np.stack([np.cos(angles), np.sin(angles), 0 * angles - 0.03], axis=1)
    reach = rr.LineStrips3D([circle], colors=(*_GREY, 120), radii=0.002 * length)
    stream.log(f"{root}/arms/reach", reach, static=True)


def send_arm(
    stream: rr.RecordingStream,
    entity: str,
    frames: np.ndarray,
    line: np.ndarray,
    colour: Colour,
    thick: float,
) -> None:
    """Sends a link (k x p x 3) [m] with its payload at the instants `frames` (k) [s]; `thick` is its radius [m]."""
    import rerun as rr

    index = rr.TimeColumn(TIMELINE, duration=frames)
    stream.log(f"{entity}/link", rr.LineStrips3D.from_fields(colors=colour, radii=thick), static=True)
    stream.send_columns(f"{entity}/link", [index], rr.LineStrips3D.columns(strips=list(line)))
    stream.log(f"{entity}/payload", rr.Points3D.from_fields(colors=colour, radii=2.2 * thick), static=True)
    stream.send_columns(f"{entity}/payload", [index], rr.Points3D.columns(positions=line[:, -1]))


def send_fork(
    stream: rr.RecordingStream, entity: str, frames: np.ndarray, heading: np.ndarray, length: float
) -> None:
    """Sends the two cheeks of the fork that holds the link, rotated by `heading` (k) [rad]."""
    import rerun as rr

    half = (0.06 * length, 0.008 * length, 0.05 * length)
    centres = [(half[0], side * 0.03 * length, 0.0) for side in (-1, 1)]
    cheeks = rr.Boxes3D(half_sizes=[half, half], centers=centres, colors=_GREY, fill_mode="solid")
    stream.log(entity, cheeks, static=True)
    turns = np.stack([0 * heading, 0 * heading, np.sin(heading / 2), np.cos(heading / 2)], axis=1)
    index = rr.TimeColumn(TIMELINE, duration=frames)
    stream.send_columns(entity, [index], rr.Transform3D.columns(quaternion=turns))


def send_scalars(
    stream: rr.RecordingStream,
    entity: str,
    time: np.ndarray,
    values: np.ndarray,
    colour: Colour,
    name: str,
    width: float,
) -> None:
    """Sends a line over time: values (m) at the instants `time` (m) [s]."""
    import rerun as rr

    stream.log(entity, rr.SeriesLines(colors=colour, names=name, widths=width), static=True)
    index = rr.TimeColumn(TIMELINE, duration=time)
    stream.send_columns(entity, [index], rr.Scalars.columns(scalars=values))


def arms_view(root: str, length: float) -> rrb.Spatial3DView:
    """Returns the view of the arms, from above."""
    import rerun.blueprint as rrb

    above = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(0.0, -0.3 * length, 2.4 * length),
        look_target=(0.0, 0.0, 0.0),
        eye_up=(0.0, 0.0, 1.0),
    )
    return rrb.Spatial3DView(
        origin=root, contents="$origin/arms/**", name="arms", eye_controls=above, line_grid=False
    )


def series_view(origin: str, title: str, window: tuple[float, float] | None = None) -> rrb.TimeSeriesView:
    """Returns the view of the lines below an entity; `window`: its time axis at first [s], None for all of it."""
    import rerun as rr
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop)
    axis = None
    if window is not None:
        start, end = (rr.TimeRangeBoundary.absolute(seconds=instant) for instant in window)
        axis = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
    return rrb.TimeSeriesView(origin=origin, name=title, plot_legend=legend, axis_x=axis)


def channel_view(
    origin: str, channel: str, what: str = "", window: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    """Returns the view of a channel; `what` is put before its label."""
    shown = labels.channel(channel)
    return series_view(origin, f"{what}{shown.label} [{shown.unit}]", window)


def blueprint(contents: rrb.Container) -> rrb.Blueprint:
    """Returns a layout with a time bar and without the viewer's other panels."""
    import rerun.blueprint as rrb

    _identify(contents, "layout")
    return rrb.Blueprint(
        contents,
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _identify(part: rrb.Container | rrb.View, place: str) -> None:
    """Gives a part of a layout and those inside it identities by their place, where rerun has random ones."""
    import rerun.blueprint as rrb

    part.id = uuid.uuid5(uuid.NAMESPACE_OID, place)
    if isinstance(part, rrb.Container):
        for index, inner in enumerate(part.contents):
            _identify(inner, f"{place}/{index}")
