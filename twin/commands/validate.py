"""`twin validate`: requirements on a controller, checked on rigs drawn from the parameter uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import (
    CONTROLLER_NAMES,
    CONTROLLERS,
    DEFAULT_RIG,
    RIGS,
    JsonFile,
    ReportFile,
    SchedulerAddress,
    completed,
    console,
    controller_file,
    executor,
    load_rig,
    progress,
    rig_file,
)
from twin.errors import InputError
from twin.files.json import write_json
from twin.files.outputs import check_writable
from twin.files.provenance import command_line, recorded

if TYPE_CHECKING:
    from twin.validation.rigs import NominalRig
    from twin.validation.validation import Validation

_STEPS = "lq-step-120, filtered-step-120, or bang-bang-20, -45, -60, -90, -120: a step of that angle."


def validate(
    controller: Annotated[
        str,
        typer.Argument(
            metavar="CONTROLLER",
            help=CONTROLLERS,
            autocompletion=completed(CONTROLLER_NAMES),
        ),
    ],
    rig: Annotated[
        str | None,
        typer.Option("--rig", metavar="NAME|FILE", help=RIGS, show_default=DEFAULT_RIG),
    ] = None,
    campaign: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Campaign that declares the rig, instead of --rig."),
    ] = None,
    rigs: Annotated[int, typer.Option(metavar="N", help="Number of rigs to draw.", min=1)] = 200,
    scenario: Annotated[str, typer.Option(metavar="NAME", help=_STEPS)] = "lq-step-120",
    seed: Annotated[int, typer.Option(metavar="SEED", help="Seed of the random draw.", min=0)] = 0,
    requirements: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Limits as TOML, see docs/validation.md.", show_default="stated defaults"
        ),
    ] = None,
    json_file: JsonFile = None,
    report_file: ReportFile = None,
    scheduler: SchedulerAddress = None,
) -> None:
    """Check requirements on a controller on randomly drawn rigs; exit code 1 where it fails them."""
    read = tuple(_read(controller, rig, campaign, requirements))
    check_writable(json_file, report_file, read=read)
    nominal = _of_rig(rig or DEFAULT_RIG) if campaign is None else _of_campaign(campaign)
    from twin.validation.requirements import defaults, read_requirements

    limits = defaults() if requirements is None else read_requirements(requirements)
    with progress() as report, executor(scheduler) as elsewhere:
        report("loading the equations of motion")
        from twin.validation import validation

        job = validation.Job(controller, nominal.rig, scenario)
        result = validation.validate(
            job, nominal.effects, nominal.errors, limits, rigs, seed, report, nominal.correlations, elsewhere
        )
        record = recorded(read, campaign, command_line(), {"drawn_rigs": seed})
        result = replace(result, provenance=record)
    if json_file is not None:
        write_json(json_file, validation.to_json(result))
    if report_file is not None:
        from twin.validation.page import write_page

        write_page(result, report_file)
    _print(result)
    if not result.passed:
        raise typer.Exit(1)


def _read(
    controller: str, rig: str | None, campaign: Path | None, requirements: Path | None
) -> Iterator[Path | None]:
    """Yields the files that a validation reads; None for options that name no file."""
    if rig is not None and campaign is not None:
        raise InputError("--rig and --campaign both say which rig; expected one of them")
    yield from (controller_file(controller), requirements)
    if rig is not None:
        yield rig_file(rig)
    if campaign is not None:
        from twin.campaigns.campaign import campaign_files

        yield from campaign_files(campaign)


def _of_rig(rig: str) -> NominalRig:
    """The nominal rig of a preset or a parameter file."""
    if Path(rig).is_dir():
        raise InputError(f"{rig} is a folder; expected a TOML file; for a campaign use --campaign")
    declared, effects = load_rig(rig)
    from twin.rigs import PRESETS
    from twin.rigs.rig_file import read_uncertainty
    from twin.validation.rigs import NominalRig

    return NominalRig(declared, effects, *(() if rig in PRESETS else read_uncertainty(rig)))


def _of_campaign(campaign: Path) -> NominalRig:
    """The nominal rig of a campaign."""
    from twin.campaigns.campaign import read_campaign
    from twin.validation.rigs import nominal_rig_of

    return nominal_rig_of(read_campaign(campaign))


def _print(result: Validation) -> None:
    from rich.table import Table

    from twin.validation import text

    screen = console()
    screen.print(text.headline(result))
    screen.print()
    table = Table("requirement", "limit", "nominal", "median", "worst", "missed", "driven by", box=None)
    for column in table.columns[1:6]:
        column.justify = "right"
    for row in text.rows(result):
        table.add_row(*row)
    screen.print(table)
    screen.print()
    for line in (*text.worst_cases(result), *text.remarks(result)):
        screen.print(line)
    screen.print()
    screen.print(text.conclusion(result))
