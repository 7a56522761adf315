"""`twin identify`: parameters of a rig from the recordings of a campaign."""

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
from twin.files.provenance import command_line, recorded

if TYPE_CHECKING:
    from rich.table import Table

    from twin.campaigns.campaign import Campaign
    from twin.identification.result import Identification

_STAGES = (
    ("reading the recordings", 0.01),
    ("calibrating", 0.26),
    ("fitting in the limit of a fine chain", 0.48),
    ("evaluating the profile likelihood", 0.04),
    ("reading decays and break-aways", 0.02),
    ("balancing torques", 0.13),
    ("predicting the held-out recordings", 0.05),
    ("writing the results", 0.01),
)
"""Stages with their share of the time of the bundled campaign."""


def identify(
    campaign: CampaignFolder,
    out: IdentificationFolder = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER",
            help="Campaign of the same rig with another payload or an air-pad, to classify resonances.",
        ),
    ] = None,
    json_file: JsonFile = None,
    force: Force = False,
    rig: DeclaredRig = None,
) -> None:
    """Identify the parameters of a rig with 95 % intervals; write a report and a parameter file."""
    from twin.campaigns.campaign import campaign_files, read_campaign
    from twin.identification import deliver

    folder = deliver.FOLDER.choose(out, campaign, force)
    read = (*campaign_files(campaign), rig, *(() if against is None else campaign_files(against)))
    written = deliver.FOLDER.output_files(folder, json_file)
    check_writable(json_file, made=folder, beside=written, read=read)
    given = _with_rig_file(read_campaign(campaign), rig)
    other = read_campaign(against) if against is not None else None
    with progress(_STAGES) as report:
        report(COMPILING)
        from twin.identification.identify import identify as run

        record = recorded(read, campaign, command_line(), {})
        result = replace(run(given, report, other=other), provenance=record)
        report("writing the results")
        paths = deliver.deliver(result, folder)
        if json_file is not None:
            write_json(json_file, result.to_json())
    _print(result, paths if json_file is None else {**paths, "JSON": json_file})


def _with_rig_file(campaign: Campaign, file: Path | None) -> Campaign:
    """The campaign with the rig, effects and standard errors of a parameter file, if there is one."""
    if file is None:
        return campaign
    from twin.campaigns.declared_rig import with_rig
    from twin.rigs.rig_file import read_rig_file, read_uncertainty

    errors, _ = read_uncertainty(file)
    return with_rig(campaign, *read_rig_file(file), errors)


def _held_out(result: Identification) -> Table:
    """Prediction errors on held-out recordings, in noise levels."""
    from rich.table import Table

    from twin import labels

    table = Table(
        "recording", "channel", "declared", "identified", "following", "windows", "steps", "start", box=None
    )
    for e in result.held_out:
        sizes = (e.declared, e.identified, e.following, e.windowed, e.by_steps)
        cells = ("–" if size is None else labels.ratio(labels.over_noise(size, e.noise)) for size in sizes)
        table.add_row(e.recording, labels.channel(e.channel).label, *cells, e.start)
    return table


def _parameters(result: Identification) -> Table:
    """The parameters, with half of their 95 % intervals unless those are withheld."""
    from rich.table import Table

    from twin import labels
    from twin.identification.text import with_half_interval
    from twin.report.prose import prose

    found = "identified, ± half its 95 % interval" if result.trust.trusted else "best fit"
    table = Table("parameter", "declared", found, "unit", "not determined", box=None)
    for name, p in result.all_parameters.items():
        declared, reason = labels.number(p.declared, labels.PAGE_DIGITS), result.not_determined.get(name, "")
        table.add_row(
            labels.parameter(name),
            declared,
            with_half_interval(p.estimate),
            labels.unit(p.unit),
            prose(reason),
        )
    return table


def _print(result: Identification, paths: dict[str, Path]) -> None:
    from twin.identification import conclusion
    from twin.report.prose import prose

    screen = console()
    screen.print(f"{result.campaign}: {conclusion.headline(result)}")
    screen.print(prose(conclusion.caveat(result)))
    screen.print()
    screen.print(_parameters(result))
    for finding in result.findings:
        screen.print(f"\n{finding.title}")
        lines = (f"not possible: {finding.missing}",) if finding.missing else finding.sentences
        for line in lines:
            screen.print(f"  {prose(line)}")
    if result.held_out:
        screen.print("\nHeld-out recordings: measured minus simulated, in noise levels")
        screen.print(_held_out(result))
    if result.notes:
        screen.print("\nAssumptions and data defects")
        for note in result.notes:
            screen.print(f"  {prose(note)}")
    screen.print()
    for what, path in paths.items():
        screen.print(f"{what:<7} {path}", soft_wrap=True)
