"""TDMS files of LabVIEW with npTDMS."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from twin.errors import InputError
from twin.files.readers.base import Content, Reader, check_count

_TIME = "time"


class Tdms(Reader):
    """A TDMS file: a column for each channel, `group/channel` where two groups have channels of one name.

    Waveforms have no column of time: it is made of their increment.
    """

    kind = "a TDMS file"
    suffixes = (".tdms",)

    def read(self, path: Path) -> Content:
        nptdms = self.library("nptdms", "npTDMS")
        self.library("nptdms.log", "npTDMS").log_manager.set_level(logging.ERROR)
        with path.open("rb") as stream, nptdms.TdmsFile.open(stream) as file:
            if file.file_status.incomplete_final_segment:
                raise InputError(
                    "its last segment is cut off; expected a file that was closed: record it anew"
                )
            channels = [channel for group in file.groups() for channel in group.channels()]
            check_count(sum(len(channel) for channel in channels))
            count = Counter(channel.name for channel in channels)
            names = [c.name if count[c.name] == 1 else f"{c.group_name}/{c.name}" for c in channels]
            columns = {name: np.asarray(c[:]) for name, c in zip(names, channels, strict=True)}
            units = {
                n: str(c.properties.get("unit_string", "")) for n, c in zip(names, channels, strict=True)
            }
            time = _time(channels) if _TIME not in columns else None
        if time is not None:
            columns, units = {_TIME: time, **columns}, {_TIME: "s", **units}
        return Content(columns, units)


def _time(channels: list[Any]) -> np.ndarray | None:
    """Instants (n) of waveforms [s]; None where there are none, or such with different ones."""
    clocks = {
        (float(c.properties.get("wf_start_offset", 0.0)), float(c.properties["wf_increment"]), len(c))
        for c in channels
        if c.properties.get("wf_increment") and len(c) > 1
    }
    if len(clocks) != 1:
        return None
    [(start, step, count)] = clocks
    return start + step * np.arange(count)
