"""Runs and recordings laid over one another: what sets each apart from the first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from twin.errors import InputError
from twin.report.run_csv import read_track
from twin.report.run_rerun import Track, differences


@dataclass(frozen=True)
class Difference:
    """One channel of two tracks.

    Attributes:
      name: of the other track.
      channel: name of the channel.
      rms: root mean square of other minus first over the time that both cover, SI.
      largest: largest magnitude of it, SI.
      spread: root mean square of the first track's channel about its mean, SI: what the difference is small against.
    """

    name: str
    channel: str
    rms: float
    largest: float
    spread: float

    @property
    def relative(self) -> float:
        """The difference as a share of the spread; nan where the first does not move."""
        return self.rms / self.spread if self.spread > 0 else float("nan")


def read_tracks(paths: Sequence[Path], rig: Mapping[str, float] | None = None) -> list[Track]:
    """Reads files, each of a run or of a campaign; files of one name are told apart by their path.

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
    first, found = tracks[0], []
    for other in tracks[1:]:
        shared = differences(first, other)
        if not shared:
            raise InputError(
                f"{other.name} and {first.name} have nothing in common: "
                f"{other.time[0]:g} to {other.time[-1]:g} s against {first.time[0]:g} to {first.time[-1]:g} s, "
                f"{', '.join(other.channels)} against {', '.join(first.channels)}"
            )
        for channel, (time, values) in shared.items():
            there = values[np.isfinite(values)]
            if not len(there):
                continue
            within = first.channels[channel][np.isin(first.time, time)]
            found.append(
                Difference(
                    other.name,
                    channel,
                    float(np.sqrt(np.mean(there**2))),
                    float(np.abs(there).max()),
                    float(np.nanstd(within)),
                )
            )
    return found


_SAME = 0.01  # of a duration, or of the range of a reference


def remarks(tracks: Sequence[Track]) -> Iterator[str]:
    """Yields a sentence for each track that lasts longer or shorter than the first, or follows another reference."""
    first = tracks[0]
    for other in tracks[1:]:
        lasts, wanted = (float(track.time[-1] - track.time[0]) for track in (other, first))
        if abs(lasts - wanted) > _SAME * wanted:
            yield (
                f"{other.name} lasts {lasts:.4g} s, {first.name} {wanted:.4g} s: "
                "they are compared over the time that both cover."
            )
        if _references_differ(first, other):
            yield f"{other.name} is of another experiment than {first.name}: its hub follows another reference."


def _references_differ(first: Track, other: Track) -> bool:
    if not all("hub_reference" in track.channels for track in (first, other)):
        return False
    wanted = first.channels["hub_reference"]
    there = np.interp(first.time, other.time, other.channels["hub_reference"])
    shared = (first.time >= other.time[0]) & (first.time <= other.time[-1])
    return float(np.mean(np.abs(there - wanted)[shared])) > _SAME * float(np.abs(wanted).max())
