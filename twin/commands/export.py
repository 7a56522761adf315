"""`twin export`: a rig with its effects for other programs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from twin.commands.shared import (
    FORMAT_NAMES,
    RIGS,
    JsonFile,
    completed,
    console,
    load_rig,
    progress,
    rig_file,
)
from twin.errors import checked_number
from twin.files.json import write_json
from twin.files.outputs import check_writable

_FURTHEST = 360.0  # degrees, hub angle about which a rig is linearised: a turn has all of them


def export(
    rig: Annotated[str, typer.Argument(metavar="RIG", help=f"{RIGS} A diagnosis writes augmented-rig.toml.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Ends in .mat (linear state space), .m (MATLAB script), .xml (MuJoCo) or .fmu (FMI 2.0).",
        ),
    ],
    format_name: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="NAME",
            help="mat, matlab, mjcf or fmu.",
            show_default="as the ending of FILE tells",
            autocompletion=completed(FORMAT_NAMES),
        ),
    ] = None,
    hub_angle: Annotated[
        float, typer.Option(metavar="DEGREES", help="Hub angle about which the linear state space is made.")
    ] = 0.0,
    json_file: JsonFile = None,
) -> None:
    """Write a rig with its effects for MATLAB, MuJoCo, tools with FMI and python-control."""
    check_writable(out, json_file, read=[rig_file(rig)])
    checked_number("--hub-angle", hub_angle, -_FURTHEST, _FURTHEST, "degrees")
    declared, effects = load_rig(rig)
    with progress() as report:
        report("loading the equations of motion")
        from twin.export import RigToExport, exporter_of
        from twin.files.whole import write_file

        exporter = exporter_of(out, format_name)
        written = exporter.export(RigToExport(declared, effects, math.radians(hub_angle)))
    write_file(out, written.content)
    if json_file is not None:
        said = {"file": str(out), "rig": declared.name, "format": exporter.name, "left_out": written.left_out}
        write_json(json_file, said)
    screen = console()
    screen.print(f"{out}: {declared.name} as {exporter.what}", soft_wrap=True)
    if written.left_out:
        screen.print(f"Left out: {', '.join(written.left_out)}")
