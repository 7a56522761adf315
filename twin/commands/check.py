"""`twin check`: the accuracy of the chain against the analytical beam model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import DEFAULT_RIG, JsonFile, RigOption, console, load_rig, progress, rig_file
from twin.errors import InputError
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.mechanics.accuracy import Check

SEGMENTS = 8
"""Segments of the chain that is checked by default."""


def check(
    rig: RigOption = DEFAULT_RIG,
    segments: Annotated[int, typer.Option(metavar="N", help="Number of segments of the chain.")] = SEGMENTS,
    json_file: JsonFile = None,
) -> None:
    """Compare the chain with the analytical beam model; exit code 1 where an error exceeds its bound."""
    check_writable(json_file, read=[rig_file(rig)])
    declared, effects = load_rig(rig)
    if effects:
        raise InputError(
            f"{rig}: has the effects {', '.join(effects)}; expected a rig without effects to check"
        )
    with progress() as report:
        from twin.mechanics import accuracy

        result = accuracy.check(declared, segments, report)
    if json_file is not None:
        from twin.rigs.bossi2009 import FREQUENCIES_HZ

        write_json(json_file, accuracy.to_json(result, FREQUENCIES_HZ))
    _print_check(result)
    if not result.passed:
        raise typer.Exit(1)


def _print_check(result: Check) -> None:
    from rich.table import Table

    from twin import labels
    from twin.mechanics.accuracy import text_rows

    screen = console()
    head = ("mode", "frequency", "chain", "simulated", "damping", "chain", "simulated", "1 − MAC")
    what = "frequencies [Hz] and damping ratios of the exact beam, the chain and a simulation"
    title = f"{result.rig}, {result.segments} segments: {what}"
    modes = Table(*head, title=title, box=None, title_justify="left", title_style="")
    for row in text_rows(result):
        modes.add_row(*row)
    verdicts = Table("quantity", "error", "bound", "", "", box=None)
    for r in result.rows:
        verdicts.add_row(
            r.quantity,
            labels.number(r.error, 2),
            labels.number(r.bound, 2),
            labels.unit(r.unit),
            "ok" if r.passed else "FAILED",
        )
    screen.print(modes)
    screen.print()
    screen.print(verdicts)
    screen.print("passed" if result.passed else "failed")
