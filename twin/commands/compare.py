"""`twin compare`: differences between runs and recordings."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import DEFAULT_RIG, RIGS, JsonFile, console, load_rig, progress, rig_file
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.report.compare import Difference


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Runs, or recordings in a campaign's folder."),
    ],
    rig: Annotated[
        str,
        typer.Option("--rig", metavar="NAME|FILE", help=f"Rig of runs; a campaign declares its own. {RIGS}"),
    ] = DEFAULT_RIG,
    rrd_file: Annotated[
        Path | None, typer.Option("--rrd", metavar="FILE", help="Write all of them into one rerun file.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Compare runs and recordings with the first one, channel by channel."""
    from twin.report.run_files import files_read

    read = [read for file in files for read in files_read(file)]
    check_writable(rrd_file, json_file, read=[*read, rig_file(rig)])
    declared, _ = load_rig(rig)
    with progress() as report:
        report("reading the files")
        from twin.report import run_rerun
        from twin.report.compare import compare as compared
        from twin.report.compare import read_tracks, remarks

        tracks = read_tracks(files, declared)
        rows = compared(tracks)
        if rrd_file is not None:
            report("writing the recording")
            name = ", ".join(track.name for track in tracks)
            run_rerun.write_rrd(tracks, tracks[0].length, rrd_file, name)
    if json_file is not None:
        write_json(
            json_file,
            {
                "first": tracks[0].name,
                "differences": [{**asdict(row), "relative": row.relative} for row in rows],
            },
        )
    _print(tracks[0].name, rows)
    for line in remarks(tracks):
        console().print(line)


def _print(first: str, rows: list[Difference]) -> None:
    from rich.table import Table

    from twin import labels

    title = f"difference from {first}"
    table = Table(
        "", "channel", "RMS", "largest", "unit", "RMS/spread", box=None, title=title, title_justify="left"
    )
    for column in (2, 3, 5):
        table.columns[column].justify = "right"
    for row in rows:
        shown = labels.channel(row.channel)
        values = (_number(shown.factor * row.rms), _number(shown.factor * row.largest))
        share = f"{_number(100 * row.relative, 2)} %" if isfinite(row.relative) else "at rest"
        table.add_row(row.name, shown.label, *values, shown.unit, share)
    console().print(table)


def _number(value: float, digits: int = 3) -> str:
    """A number with this many significant digits, without exponent where it is large."""
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"
