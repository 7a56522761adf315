"""`twin plan-experiment`: the experiment that distinguishes best between two explanations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import COMPILING, CampaignFolder, JsonFile, console, progress
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.diagnosis.plan import ExperimentPlan


def plan_experiment(
    campaign: CampaignFolder,
    between: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="EFFECT EFFECT",
            help="Two effects to distinguish.",
            show_default="the two with the highest scores",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "--torque",
            metavar="FILE",
            help="Write the torque of the best experiment here: .csv, .mat, .parquet or .mcap.",
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Find the experiment that distinguishes best between two explanations of a campaign; write its torque."""
    from twin.campaigns.campaign import campaign_files, read_campaign
    from twin.files.writers import check_table

    check_writable(out, json_file, read=campaign_files(campaign))
    check_table(out)
    given = read_campaign(campaign)
    with progress() as report:
        report(COMPILING)
        from twin.diagnosis.plan import plan, to_json, write_torque

        planned = plan(given, between, report)
    written = write_torque(planned.plans, out) if out is not None else None
    if json_file is not None:
        write_json(json_file, to_json(planned))
    _print(planned)
    if written is not None:
        text = f"{out} has the torque of {written.experiment.name}: {written.experiment.how}"
        console().print(text, soft_wrap=True)


def _print(planned: ExperimentPlan) -> None:
    from rich.table import Table

    from twin.diagnosis import experiments
    from twin.report.prose import prose

    screen = console()
    screen.print(prose(planned.recommendation()))
    table = Table("experiment", "what to do", "noise levels apart", "in", "with another sensor", box=None)
    for row in experiments.rows(planned.plans):
        table.add_row(*row)
    screen.print(table)
