"""Runs as a rerun recording: arms in 3D, references, readings, torques, friction and controller states over time.

A track is a run of a simulation, or a recording of the rig. A run can be sent in pieces while it is computed.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from twin import labels
from twin.control.closed_loop import Run
from twin.errors import InputError
from twin.files.whole import write_file
from twin.recording import Recording, Sensor
from twin.report import rerun_parts as parts

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

COLOURS: tuple[parts.Colour, ...] = ((60, 150, 220), (230, 112, 30), (165, 172, 180), (214, 90, 160))
"""Colours of the tracks in their order: blue, orange, grey, pink, which differ for all kinds of colour vision."""

_GREY, _LIMIT = (150, 156, 164), (200, 60, 60)
_ROOT = "/run"
_PLOTTED = ("hub_angle", "tip_deflection", "strain_base", "strain_mid")
_DIFFERENCES = ("hub_angle", "tip_deflection")


@dataclass(frozen=True)
class Track:
    """One arm at m instants.

    Attributes:
      name: shown in the viewer.
      time: (m) [s].
      line: (m, k, 2) centre line of the link [m].
      channels: name -> (m), SI: readings, hub_reference, torque_command.
      modes: (m) 0 while the hub sticks, else its direction; None if unknown.
      states: name -> (m) of the controller.
      torque_limit: of the amplifier [N m]; None if unknown.
    """

    name: str
    time: np.ndarray
    line: np.ndarray = field(repr=False)
    channels: Mapping[str, np.ndarray] = field(repr=False)
    modes: np.ndarray | None = None
    states: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)
    torque_limit: float | None = None

    @property
    def length(self) -> float:
        """Length of the link [m], along its line at the first instant."""
        return float(np.linalg.norm(np.diff(self.line[0], axis=0), axis=1).sum())

    def content(self) -> Iterator[str | np.ndarray]:
        """All that tells this track from another."""
        yield self.name
        yield self.line
        yield from parts.content_of(self.time, {**self.channels, **self.states})


def of_run(run: Run, name: str) -> Track:
    """Returns the track of a run."""
    channels = {**run.true, "hub_reference": run.reference, "torque_command": run.torque_command}
    return Track(name, run.time, run.outline, channels, run.modes, run.states, run.torque_limit)


def of_recording(recording: Recording, length: float, sensors: Mapping[str, Sensor]) -> Track:
    """Returns the track of a recording; the shape of the link follows from its sensors."""
    line = parts.centre_line(recording, recording.time, length, sensors)
    return Track(recording.name, recording.time, line, recording.channels)


class RunStream:
    """A rerun stream of tracks, which may be sent in pieces.

    The first track is the main one; the others are ghosts, drawn thinner and a little above.
    """

    def __init__(self, stream: rr.RecordingStream, tracks: Sequence[Track], length: float) -> None:
        """Sends the layout.

        Args:
          stream: where to.
          tracks: first pieces; their channels determine the views.
          length: of the link [m].
        """
        self._stream, self._length = stream, length
        stream.send_blueprint(_blueprint(tracks, length))
        parts.send_scenery(stream, _ROOT, length)
        self._drawn = [-np.inf] * len(tracks)

    def send(self, index: int, piece: Track) -> None:
        """Sends a piece of the track with this index."""
        safe = f"{index}_{parts.entity_name(piece.name)}"
        self._send_arm(index, safe, piece)
        width = 2.5 if index == 0 else 1.5
        for channel in _PLOTTED:
            if channel in piece.channels:
                values = labels.channel(channel).factor * piece.channels[channel]
                self._line(f"{channel}/{safe}", piece, values, COLOURS[index % 4], piece.name, width)
        if "motor_torque" in piece.channels:
            torque = piece.channels["motor_torque"]
            self._line(f"torque/{safe}", piece, torque, COLOURS[index % 4], piece.name, width)
        if index == 0:
            self._send_loop(piece)

    def send_differences(self, first: Track, others: Sequence[Track]) -> None:
        """Sends the difference of each other track from the first, where both have samples."""
        for index, other in enumerate(others, start=1):
            for channel, (time, values) in differences(first, other).items():
                if channel in _DIFFERENCES:
                    scaled = labels.channel(channel).factor * values
                    entity = f"{_ROOT}/difference_{channel}/{index}_{parts.entity_name(other.name)}"
                    parts.send_scalars(
                        self._stream,
                        entity,
                        time,
                        scaled,
                        COLOURS[index % 4],
                        f"{other.name} - {first.name}",
                        1.5,
                    )

    def _send_arm(self, index: int, name: str, piece: Track) -> None:
        # One frame for each 1/60 s, at any sample rate.
        frames = np.floor(piece.time * parts.FRAME_RATE + 1e-9)
        new = np.flatnonzero(np.diff(frames, prepend=self._drawn[index]) > 0)
        if not len(new):
            return
        self._drawn[index] = frames[-1]
        line = piece.line[new]
        thick = (0.016 if index == 0 else 0.008) * self._length
        place, times = f"{_ROOT}/arms/{name}", piece.time[new]
        whole = parts.raised(line, index, self._length)
        parts.send_arm(self._stream, place, times, whole, COLOURS[index % 4], thick)
        if index == 0:
            heading = np.unwrap(np.arctan2(line[:, 1, 1], line[:, 1, 0]))
            parts.send_fork(self._stream, f"{_ROOT}/arms/fork", times, heading, self._length)

    def _send_loop(self, piece: Track) -> None:
        """Sends what only the first track shows: reference, command and limits, friction mode, controller states."""
        if "hub_reference" in piece.channels:
            reference = labels.channel("hub_angle").factor * piece.channels["hub_reference"]
            self._line("hub_angle/reference", piece, reference, _GREY, "reference", 1.0)
        if "torque_command" in piece.channels:
            self._line("torque/command", piece, piece.channels["torque_command"], _GREY, "command", 1.0)
        if piece.torque_limit is not None and np.isfinite(piece.torque_limit):
            for name, sign in (("upper", 1), ("lower", -1)):
                limit = np.full(len(piece.time), sign * piece.torque_limit)
                self._line(f"torque/limit_{name}", piece, limit, _LIMIT, f"{name} limit", 1.0)
        if piece.modes is not None:
            self._line("friction/mode", piece, piece.modes.astype(float), COLOURS[0], "hub", 1.5)
        for place, (name, values) in enumerate(piece.states.items()):
            self._line(f"controller/{parts.entity_name(name)}", piece, values, COLOURS[place % 4], name, 1.5)

    def _line(
        self, entity: str, piece: Track, values: np.ndarray, colour: parts.Colour, name: str, width: float
    ) -> None:
        parts.send_scalars(self._stream, f"{_ROOT}/{entity}", piece.time, values, colour, name, width)


def differences(first: Track, other: Track) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Returns channel -> times (k) [s] of the first track and other minus first (k), SI, interpolated linearly."""
    start, end = max(first.time[0], other.time[0]), min(first.time[-1], other.time[-1])
    shared = (first.time >= start) & (first.time <= end)
    time = first.time[shared]
    result = {}
    for channel in first.channels:
        if channel not in other.channels or channel in ("hub_reference", "torque_command"):
            continue
        known = np.isfinite(other.channels[channel])
        if known.any() and len(time):
            values = np.interp(time, other.time[known], other.channels[channel][known])
            result[channel] = (time, values - first.channels[channel][shared])
    return result


def write_rrd(tracks: Sequence[Track], length: float, path: Path, name: str) -> None:
    """Writes tracks for the rerun viewer (`rerun FILE`), with their layout.

    Args:
      tracks: the first is the main one, the others are laid over it, with their difference.
      length: of the link [m].
      path: the file; it is overwritten.
      name: of the recording.

    Raises:
      InputError: the file cannot be written.
    """
    content = [part for track in tracks for part in track.content()]
    with parts.in_memory(name, content) as (stream, storage):
        sender = RunStream(stream, tracks, length)
        for index, track in enumerate(tracks):
            sender.send(index, track)
        sender.send_differences(tracks[0], tracks[1:])
        written = storage.drain_as_bytes()
    write_file(path, written)


def open_viewer(name: str) -> rr.RecordingStream:
    """Returns a stream into the viewer, which is started if none runs.

    Raises:
      InputError: it cannot be started.
    """
    import rerun as rr

    stream = rr.RecordingStream(parts.APPLICATION)
    try:
        rr.spawn(executable_path=viewer_executable(), recording=stream)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(f"the rerun viewer cannot be started: {reason}") from None
    stream.send_recording_name(name)
    return stream


def viewer_executable() -> str | None:
    """Returns the path of the viewer, or None if it is not installed."""
    # It is beside the interpreter, which is not on PATH unless its environment is activated.
    return shutil.which("rerun", path=Path(sys.executable).parent)


def close(stream: rr.RecordingStream) -> None:
    """Flushes and closes a stream."""
    stream.flush()
    stream.disconnect()


# Layout


def _blueprint(tracks: Sequence[Track], length: float) -> rrb.Blueprint:
    import rerun.blueprint as rrb

    channels = [c for c in _PLOTTED if any(c in track.channels for track in tracks)]
    plots: list[Any] = [parts.channel_view(f"{_ROOT}/{channel}", channel) for channel in channels]
    plots.append(parts.series_view(f"{_ROOT}/torque", "torque [N·m]"))
    if len(tracks) > 1:
        shared = [c for c in _DIFFERENCES if all(c in track.channels for track in tracks[:2])]
        plots += [parts.channel_view(f"{_ROOT}/difference_{c}", c, "difference of ") for c in shared]
    below: list[Any] = []
    if tracks[0].modes is not None:
        below.append(parts.series_view(f"{_ROOT}/friction", "hub: sliding back -1, sticking 0, sliding on 1"))
    if tracks[0].states:
        below.append(parts.series_view(f"{_ROOT}/controller", "states of the controller"))
    arms = parts.arms_view(_ROOT, length)
    left = rrb.Vertical(arms, *below, row_shares=[3] + [1] * len(below))
    return parts.blueprint(rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[5, 6]))
