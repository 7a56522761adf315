"""`twin identify`: the rig's parameters from a campaign's recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import JsonFile, check_writable, console, progress
from twin.json_file import write_json

if TYPE_CHECKING:
    from twin.identify.identification import Identification


def identify(
    campaign: Annotated[Path, typer.Argument(help="Folder with campaign.toml and the recordings.")],
    json_file: JsonFile = None,
) -> None:
    """Identify the rig: stiffness, damping, frictions, inertias, each with its interval."""
    check_writable(json_file)
    from twin.campaign import read_campaign

    given = read_campaign(campaign)
    with progress() as report:
        report("loading the equations of motion; the first time they are compiled, which takes minutes")
        from twin.identify.identification import identify as run

        found = run(given, report)
    if json_file is not None:
        write_json(json_file, found.to_json())
    _print(found)


def _print(found: Identification) -> None:
    from rich.table import Table

    screen = console()
    table = Table("parameter", "declared", "identified", "\u00b1", "unit", "by itself", box=None)
    for name, p in found.parameters.items():
        own = ", ".join(f"{k} {e.value:.4g} \u00b1 {e.standard_error:.1g}" for k, e in p.methods.items())
        table.add_row(name, f"{p.declared:.5g}", f"{p.value:.5g}", f"{p.standard_error:.1g}", p.unit, own)
    screen.print(f"{found.campaign}: identified from its fit recordings", highlight=False, markup=False)
    screen.print(table, highlight=False)
