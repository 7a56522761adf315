"""`twin data`: the data of a campaign before anything is fitted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from twin.commands.shared import COMPILING, CampaignFolder, JsonFile, ReportFile, console, progress
from twin.files.json import write_json
from twin.files.outputs import check_writable
from twin.files.provenance import command_line, recorded

if TYPE_CHECKING:
    from twin.report.data_check import DataCheck


_STAGES = (
    ("reading the recordings", 0.05),
    ("loading the equations of motion", 0.15),
    ("looking at the recordings", 0.1),
    ("simulating the declared model", 0.1),
    ("effect", 0.6),
)
"""Stages with their share of the time of the bundled campaign."""


def data(
    campaign: CampaignFolder,
    report_file: ReportFile = None,
    json_file: JsonFile = None,
) -> None:
    """Look at the data of a campaign before a fit: what would mislead it, and what they can show.

    Exit code 1 where a fit would be misled, or nothing would show.
    """
    from twin.campaigns.campaign import campaign_files, read_campaign

    read = campaign_files(campaign)
    check_writable(report_file, json_file, read=read)
    with progress(_STAGES, first_line=0.0) as report:
        report("reading the recordings")
        given = read_campaign(campaign)
        report(COMPILING)
        from twin.report import data_check

        record = recorded(read, campaign, command_line(), {})
        found = replace(data_check.check_data(given, report), provenance=record)
    if json_file is not None:
        write_json(json_file, found.to_json())
    if report_file is not None:
        data_check.write_page(found, report_file)
    _print(found)
    if not found.passed:
        raise typer.Exit(1)


def _print(found: DataCheck) -> None:
    from rich.table import Table

    from twin.report import data_check

    screen = console()
    screen.print(data_check.headline(found))
    screen.print()
    table = Table(box=None, show_header=False)
    for row in data_check.rows(found):
        table.add_row(*row)
    screen.print(table)
    screen.print(f"\nWhat the recordings can show. {data_check.EXPLANATION}\n")
    visible = Table("effect", "parameter", "standard error", data_check.FOUND, box=None)
    for column in visible.columns[2:]:
        column.justify = "right"
    for cells in data_check.visible_rows(found):
        visible.add_row(*cells)
    screen.print(visible)
    screen.print()
    screen.print(data_check.expected(found))
