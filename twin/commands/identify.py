"""`twin identify`: the rig's parameters from a campaign's recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import (
    COMPILING,
    CampaignFolder,
    DeclaredRig,
    Force,
    IdentificationFolder,
    JsonFile,
    console,
    progress,
)
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from rich.table import Table

    from twin.campaigns.campaign import Campaign
    from twin.identification.result import Identification


def identify(
    campaign: CampaignFolder,
    out: IdentificationFolder = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER",
            help="Campaign of the same rig with another payload or an air-pad: which peaks move.",
        ),
    ] = None,
    json_file: JsonFile = None,
    force: Force = False,
    rig: DeclaredRig = None,
) -> None:
    """Identify a rig: each parameter with its interval and the evidence; write a report and a rig file."""
    from twin.campaigns.campaign import files_of, read_campaign
    from twin.identification import deliver

    folder = deliver.FOLDER.chosen(out, campaign, force)
    read = (*files_of(campaign), rig, *(() if against is None else files_of(against)))
    written = deliver.FOLDER.written(folder, json_file)
    check_writable(json_file, made=folder, beside=written, read=read)
    given = _known(read_campaign(campaign), rig)
    other = read_campaign(against) if against is not None else None
    with progress() as report:
        report(COMPILING)
        from twin.identification.identify import identify as run

        found = run(given, report, other=other)
        report("writing the results")
        paths = deliver.deliver(found, folder)
        if json_file is not None:
            write_json(json_file, found.to_json())
    _print(found, paths if json_file is None else {**paths, "JSON": json_file})


def _known(campaign: Campaign, file: Path | None) -> Campaign:
    """The campaign, its rig and what acts on it declared by a parameter file, if there is one."""
    if file is None:
        return campaign
    from twin.rigs.rig_file import read_rig_file, read_uncertainty

    rig, effects = read_rig_file(file)
    errors, _ = read_uncertainty(file)
    return replace(campaign, rig=rig, effects=effects, effect_errors=errors)


def _held_out(found: Identification) -> Table:
    from rich.table import Table

    table = Table(
        "recording", "channel", "declared", "identified", "following", "windows", "steps", "start", box=None
    )
    for e in found.held_out:
        sizes = (e.declared, e.identified, e.following, e.windowed, e.by_steps)
        cells = ("-" if size is None else f"{size / e.noise:.3g}" for size in sizes)
        table.add_row(e.recording, e.channel, *cells, e.start)
    return table


def _print(found: Identification, paths: dict[str, Path]) -> None:
    from rich.table import Table

    from twin.identification.text import format_estimate

    screen = console()
    screen.print(f"{found.campaign}: identified", highlight=False, markup=False)
    table = Table("parameter", "declared", "identified (95 % interval)", "unit", "not determined", box=None)
    for name, p in found.all_parameters.items():
        table.add_row(
            name, f"{p.declared:.5g}", format_estimate(p.estimate), p.unit, found.not_determined.get(name, "")
        )
    screen.print(table, highlight=False)
    for finding in found.findings:
        screen.print(f"\n{finding.title}", highlight=False, markup=False)
        lines = (f"not possible: {finding.missing}",) if finding.missing else finding.sentences
        for line in lines:
            screen.print(f"  {line}", highlight=False, markup=False)
    if found.held_out:
        screen.print("\nHeld-out recordings: measured minus simulated, in noise levels", highlight=False)
        screen.print(_held_out(found), highlight=False)
    if found.notes:
        screen.print("\nAssumptions and data defects", highlight=False)
        for note in found.notes:
            screen.print(f"  {note}", highlight=False, markup=False)
    screen.print()
    for what, path in paths.items():
        screen.print(f"{what:<7} {path}", highlight=False, markup=False, soft_wrap=True)
