"""Differences of runs and recordings from a first one, channel by channel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.errors import InputError, exact
from twin.report.run_files import read_track
from twin.report.run_rerun import Track, differences

_TOLERANCE = 0.01
"""Relative difference of durations, or of references over the largest reference, that is not remarked on [1]."""


@dataclass(frozen=True)
class Difference:
    """Difference of one channel between two tracks.

    Attributes:
      name: of the other track.
      channel: name of the channel.
      rms: root mean square of other minus first over the time that both cover, SI.
      largest: largest magnitude of the difference, SI.
      spread: standard deviation of the first track's channel, for comparison, SI.
    """

    name: str
    channel: str
    rms: float
    largest: float
    spread: float

    @property
    def relative(self) -> float:
        """RMS difference over the spread [1]; NaN where the first track is constant."""
        return self.rms / self.spread if self.spread > 0 else float("nan")


def read_tracks(paths: Sequence[Path], rig: Mapping[str, float] | None = None) -> list[Track]:
    """Reads files of runs or of campaigns; files of the same name are named by their path.

    Args:
      paths: the files.
      rig: of the runs; None for `bossi2009`.

    Raises:
      InputError: a file cannot be used, or there are fewer than two.
    """
    if len(paths) < 2:
        raise InputError(f"got {len(paths)} file; expected two or more to compare")
    count = Counter(path.name for path in paths)
    tracks = [read_track(path, rig) for path in paths]
    return [
        replace(track, name=str(path)) if count[path.name] > 1 else track
        for path, track in zip(paths, tracks, strict=True)
    ]


def compare(tracks: Sequence[Track]) -> list[Difference]:
    """Returns the differences of every other track from the first, channel by channel.

    Raises:
      InputError: two tracks have no time or no channel in common.
    """
    first, rows = tracks[0], []
    for other in tracks[1:]:
        shared = differences(first, other)
        if not shared:
            raise InputError(
                f"{other.name} and {first.name} have nothing in common: "
                f"{_span(other)} against {_span(first)}, "
                f"{', '.join(other.channels)} against {', '.join(first.channels)}"
            )
        for channel, (time, values) in shared.items():
            there = values[np.isfinite(values)]
            if not len(there):
                continue
            within = first.channels[channel][np.isin(first.time, time)]
            rows.append(
                Difference(
                    other.name,
                    channel,
                    float(np.sqrt(np.mean(there**2))),
                    float(np.abs(there).max()),
                    float(np.nanstd(within)),
                )
            )
    return rows


def _span(track: Track) -> str:
    return f"{exact(track.time[0])} to {exact(track.time[-1])} s"


def remarks(tracks: Sequence[Track]) -> Iterator[str]:
    """Yields a sentence for each track whose duration or reference differs from that of the first."""
    first = tracks[0]
    for other in tracks[1:]:
        duration, first_duration = (float(track.time[-1] - track.time[0]) for track in (other, first))
        if abs(duration - first_duration) > _TOLERANCE * first_duration:
            yield (
                f"{other.name} lasts {duration:.4g} s, {first.name} {first_duration:.4g} s: "
                "they are compared over the time that both cover."
            )
        if _references_differ(first, other):
            yield f"{other.name} is of another experiment than {first.name}: its hub follows another reference."


def _references_differ(first: Track, other: Track) -> bool:
    if not all("hub_reference" in track.channels for track in (first, other)):
        return False
    reference = first.channels["hub_reference"]
    other_reference = np.interp(first.time, other.time, other.channels["hub_reference"])
    shared = (first.time >= other.time[0]) & (first.time <= other.time[-1])
    difference = float(np.mean(np.abs(other_reference - reference)[shared]))
    return difference > _TOLERANCE * float(np.abs(reference).max())
