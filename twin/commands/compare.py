"""`twin compare`: runs and recordings laid over one another."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import JsonFile, console, progress
from twin.json_file import write_json
from twin.outputs import check_writable

if TYPE_CHECKING:
    from twin.compare import Difference


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="A.csv B.csv ...", help="Runs, or recordings in a campaign's folder."),
    ],
    rrd_file: Annotated[
        Path | None, typer.Option("--rrd", metavar="FILE", help="Lay them over one another here, for rerun.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Lay runs and recordings over one another on one timeline, with their difference from the first."""
    from twin.run_files import files_read

    check_writable(rrd_file, json_file, read=[read for file in files for read in files_read(file)])
    with progress() as report:
        report("reading the files")
        from twin import run_stream
        from twin.compare import compare as compared
        from twin.compare import read_tracks
        from twin.rigs import preset

        tracks = read_tracks(files)
        rows = compared(tracks)
        if rrd_file is not None:
            report("writing the recording")
            length = preset("bossi2009")["length"]
            run_stream.write_rrd(tracks, length, rrd_file, ", ".join(track.name for track in tracks))
    if json_file is not None:
        write_json(
            json_file,
            {
                "first": tracks[0].name,
                "differences": [{**asdict(row), "relative": row.relative} for row in rows],
            },
        )
    _print(tracks[0].name, rows)


def _print(first: str, rows: list[Difference]) -> None:
    from rich.table import Table

    from twin.report import display

    title = f"difference from {first}"
    table = Table(
        "", "channel", "RMS", "largest", "unit", "RMS/span", box=None, title=title, title_justify="left"
    )
    for row in rows:
        shown = display.channel(row.channel)
        values = (f"{shown.factor * row.rms:.3g}", f"{shown.factor * row.largest:.3g}")
        table.add_row(row.name, shown.label, *values, shown.unit, f"{100 * row.relative:.2g} %")
    console().print(table, highlight=False)
