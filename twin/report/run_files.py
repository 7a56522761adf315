"""Runs as files in the recording format, written and read."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from twin.campaigns.campaign import campaign_files, read_campaign
from twin.control.closed_loop import Run
from twin.errors import InputError, listed
from twin.files.readers import SUFFIXES, read_recording
from twin.files.table import Table
from twin.files.time_column import checked_time
from twin.files.writers import mcap, write_table
from twin.files.writers.base import Units
from twin.recording import CHANNEL_UNITS, Recording, Sensor, gauges_on
from twin.report.run_rerun import Track, of_recording
from twin.rigs import preset

_OTHER_SUFFIXES = (".json", ".rrd", ".toml", ".html")  # of other files that the twin writes


def columns(run: Run) -> dict[str, np.ndarray]:
    """Returns the columns (m each) of a run by name: time, channels, friction mode and controller states."""
    channels = run.recording("run").channels
    states = {f"state_{name}": values for name, values in run.states.items()}
    return {"time": run.time, **channels, "mode": run.modes, **states}


UNITS: Units = {"time": "s", **CHANNEL_UNITS, "mode": "1"}
"""Column -> SI unit; those of a controller's states are not known."""


def write_run(run: Run, path: Path) -> None:
    """Writes a run in the format that the ending of the file tells.

    Raises:
      InputError: there is no such format, its library is not installed, or the path cannot be written.
    """
    write_table(columns(run), UNITS, path)


def is_file_of_run(name: str) -> bool:
    """Whether a name ends as that of a run or recording does."""
    return Path(name).suffix.lower() in SUFFIXES


def read_track(path: Path, rig: Mapping[str, float] | None = None) -> Track:
    """Reads a file as a track: of a campaign, if its folder has a campaign.toml, else of a run.

    Args:
      path: the file.
      rig: length [m] and torque limit [N m] of a run, which its file does not contain; None for `bossi2009`. A campaign
        declares its own.

    Raises:
      InputError: the file, or its campaign, cannot be used.
    """
    folder = _campaign_of(path)
    if folder is not None:
        campaign, name = read_campaign(folder), path.absolute().relative_to(folder.absolute()).as_posix()
        recordings = {r.name: r for r in (*campaign.fit, *campaign.holdout())}
        if name not in recordings:
            raise InputError(f"{path}: its campaign has no such recording; it has {listed(recordings)}")
        return _track_of_recording(recordings[name], campaign.rig, campaign.sensors)
    return _track_of_run(path, preset("bossi2009") if rig is None else rig)


def _track_of_recording(
    recording: Recording, rig: Mapping[str, float], sensors: Mapping[str, Sensor]
) -> Track:
    return replace(of_recording(recording, rig["length"], sensors), torque_limit=rig["torque_limit"])


def files_read(path: Path) -> tuple[Path, ...]:
    """Returns the files that `read_track` reads.

    Raises:
      InputError: the campaign of the file cannot be used.
    """
    folder = _campaign_of(path)
    return (path,) if folder is None else (path, *campaign_files(folder))


def _campaign_of(path: Path) -> Path | None:
    """The folder of the campaign of a file: its own, or one above it whose campaign names it.

    Raises:
      InputError: a campaign above it cannot be used.
    """
    if os.path.lexists(path.parent / "campaign.toml"):
        return path.parent
    file = path.absolute()
    above = (f for f in file.parents[1:] if os.path.lexists(f / "campaign.toml"))
    return next((f for f in above if file in campaign_files(f)), None)


def _track_of_run(path: Path, rig: Mapping[str, float]) -> Track:
    """The track of a file with a column for each channel, in SI units, as `write_run` writes it."""
    if path.suffix.lower() in _OTHER_SUFFIXES and path.is_file():
        raise InputError(
            f"{path} is no run; expected a file as `twin run --out` writes it, or a recording of a campaign"
        )
    table = _without_topic(read_recording(path, path.name))
    if "time" not in table.columns or "hub_angle" not in table.columns:
        raise InputError(
            f"{path}: has the columns {listed(table.header)}; expected time and hub_angle, as `twin run --out` "
            "writes them, or a campaign.toml beside it that says what its columns are"
        )
    channels = {name: v for name, v in table.columns.items() if name in CHANNEL_UNITS}
    recording = Recording(path.name, checked_time(table, "time"), channels)
    track = _track_of_recording(recording, rig, gauges_on(rig["length"]))
    states = {n.removeprefix("state_"): v for n, v in table.columns.items() if n.startswith("state_")}
    return replace(track, modes=table.columns.get("mode"), states=states)


def _without_topic(table: Table) -> Table:
    """The table of an MCAP file with the names that its columns had before they were written."""
    names = {name: name.removeprefix(f"{mcap.TOPIC}.") for name in table.header}
    columns = {names[name]: values for name, values in table.columns.items()}
    return replace(table, header=tuple(names.values()), columns=columns)
