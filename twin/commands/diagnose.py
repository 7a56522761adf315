"""`twin demo` and `twin diagnose`: which physical effect the model of a campaign lacks, or of many rigs each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from twin.commands.fleet import FleetOptions, diagnose_fleet
from twin.commands.opening import Opener, check_opener, open_results
from twin.commands.shared import (
    COMPILING,
    DeclaredRig,
    DiagnosisFolder,
    Force,
    JsonFile,
    SchedulerAddress,
    console,
    progress,
)
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.campaigns.campaign import Campaign

_STAGES = (
    ("reading the recordings", 0.01),
    ("calibrating", 0.11),
    ("scoring the effects", 0.26),
    ("comparing", 0.42),
    ("computing standard errors", 0.02),
    ("simulating every recording", 0.17),
    ("writing the results", 0.01),
)
"""Stages with their share of the time of the bundled campaign, in which one effect is found; later rounds of the search
count with the comparison before them."""


def demo(
    out: DiagnosisFolder = None, json_file: JsonFile = None, force: Force = False, opener: Opener = None
) -> None:
    """Diagnose the bundled campaign of a virtual rig with one undeclared effect."""
    from importlib.resources import as_file, files

    with as_file(files("twin") / "data" / "demo-rig") as folder:
        _diagnose(folder, out, json_file, force, opener=opener)


def diagnose(
    campaigns: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAMPAIGN",
            help="Folder with campaign.toml and the recordings; several for a fleet, whose rigs are told apart by the "
            "name in campaign.toml.",
        ),
    ],
    out: DiagnosisFolder = None,
    json_file: JsonFile = None,
    force: Force = False,
    false_alarm_rate: Annotated[
        float, typer.Option(metavar="RATE", help="Probability of finding an effect where none is missing.")
    ] = 0.01,
    rig: DeclaredRig = None,
    opener: Opener = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Of several campaigns: processes, a campaign each; of one: threads.",
            show_default="one a processor",
            min=1,
        ),
    ] = None,
    scheduler: SchedulerAddress = None,
) -> None:
    """Find which physical effect the declared model lacks; write report, rerun recording and augmented model."""
    if len(campaigns) == 1 and scheduler is None:
        _diagnose(campaigns[0], out, json_file, force, false_alarm_rate, rig, opener, workers)
    else:
        options = FleetOptions(out, json_file, force, false_alarm_rate, rig, opener, workers, scheduler)
        diagnose_fleet(campaigns, options)


def _with_rig_file(campaign: Campaign, file: Path) -> Campaign:
    """The campaign with the rig and effects of a parameter file.

    The standard errors of its effects are not used: an effect may have changed, so that it is fitted anew.
    """
    from twin.campaigns.declared_rig import with_rig
    from twin.rigs.rig_file import read_rig_file

    return with_rig(campaign, *read_rig_file(file))


def _diagnose(
    campaign: Path,
    out: Path | None,
    json_file: Path | None,
    force: bool,
    rate: float = 0.01,
    rig: Path | None = None,
    opener: Literal["report", "viewer"] | None = None,
    workers: int | None = None,
) -> None:
    from twin.campaigns.campaign import campaign_files, read_campaign
    from twin.files import provenance
    from twin.report import deliver, print_summary

    check_opener(opener)
    folder = deliver.FOLDER.choose(out, campaign, force)
    written, read = deliver.FOLDER.output_files(folder, json_file), (*campaign_files(campaign), rig)
    check_writable(json_file, made=folder, beside=written, read=read)
    given = read_campaign(campaign)
    if rig is not None:
        given = _with_rig_file(given, rig)
    with progress(_STAGES) as report:
        report(COMPILING)
        from twin.diagnosis.diagnose import diagnose as loop
        from twin.diagnosis.permutation import SEEDS

        record = provenance.recorded(read, campaign, provenance.command_line(), SEEDS)
        result = replace(loop(given, report, workers, false_alarm_rate=rate), provenance=record)
        report("writing the results")
        delivery = deliver.deliver(result, given.sensors, folder)
        if json_file is not None:
            write_json(json_file, result.to_json())
    answer = {} if json_file is None else {"JSON": json_file}
    screen = console()
    print_summary(result, screen, {**delivery.paths, **answer})
    if delivery.left_out:
        missing = ", ".join(delivery.left_out)
        screen.print(f"{delivery.paths['MJCF'].name} leaves out: {missing}")
    failed = open_results(opener, delivery.paths)
    if failed:
        screen.print(failed)
