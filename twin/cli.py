"""The command line: arguments in, text and exit code out. One function per command.

What the user gave and cannot be used ends in `Error: ...` and exit code 2. Heavy modules are imported where a
command needs them, so that help comes at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.errors import InputError
from twin.json_file import write_json

if TYPE_CHECKING:
    from rich.console import Console

    from twin.check import Check

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None
)

INTERRUPTED = 130
_WIDTH = 110  # of tables that go into a file or a pipe

JsonFile = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the result here, as JSON.")
]
OutFolder = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="FOLDER", help="Folder of the results.", show_default="<campaign>-diagnosis"
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Write into a folder that holds something else.")]


def main() -> None:
    """Runs the command; 2 where its input cannot be used, 130 where it was interrupted."""
    try:
        app()
    except InputError as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)
    except SystemExit as end:
        # What typer makes of Ctrl-C, without a word.
        if end.code == INTERRUPTED:
            print("Interrupted.", file=sys.stderr)
        raise


@app.callback()
def root() -> None:
    """A MuJoCo digital twin of a planar flexible manipulator that finds what its model lacks."""


@app.command()
def demo(out: OutFolder = None, json_file: JsonFile = None, force: Force = False) -> None:
    """Diagnose the bundled campaign, recorded on a virtual rig with an effect that it does not declare."""
    from importlib.resources import as_file, files

    with as_file(files("twin") / "data" / "demo-rig") as folder:
        _diagnose(folder, out, json_file, force)


@app.command()
def diagnose(
    campaign: Annotated[Path, typer.Argument(help="Folder with campaign.toml and the recordings.")],
    out: OutFolder = None,
    json_file: JsonFile = None,
    force: Force = False,
) -> None:
    """Find which physical effect a model lacks; write report, rerun recording and augmented model."""
    _diagnose(campaign, out, json_file, force)


def _diagnose(campaign: Path, out: Path | None, json_file: Path | None, force: bool) -> None:
    from twin import deliver
    from twin.campaign import read_campaign
    from twin.report import print_summary

    folder = out if out is not None else deliver.default_folder(campaign)
    deliver.check_folder(folder, force)
    if json_file is not None:
        deliver.check_file(json_file, folder)
    given = read_campaign(campaign)
    with progress() as report:
        report("loading the equations of motion; the first time they are compiled, which takes minutes")
        from twin.diagnose import diagnose as loop

        found = loop(given, report)
        report("writing the results")
        delivery = deliver.deliver(found, given.sensors, folder)
        if json_file is not None:
            write_json(json_file, found.to_json())
    answer = {} if json_file is None else {"JSON": json_file}
    screen = console()
    print_summary(found, screen, {**delivery.paths, **answer})
    if delivery.left_out:
        missing = ", ".join(delivery.left_out)
        screen.print(f"{delivery.paths['MJCF'].name} leaves out: {missing}", highlight=False, markup=False)


@app.command()
def check(
    rig: Annotated[str, typer.Option(help="A published rig: bossi2009 or bossi2009-printed.")] = "bossi2009",
    segments: Annotated[int, typer.Option(help="Number of segments of the chain.")] = 8,
    json_file: JsonFile = None,
) -> None:
    """Hold the chain against the analytical model; exit code 1 where it is off."""
    from twin.rigs import preset

    declared = preset(rig)
    with progress() as report:
        from twin import check as chain_check

        result = chain_check.check(declared, segments, report)
    if json_file is not None:
        write_json(json_file, chain_check.to_json(result))
    _print_check(result)
    if not result.passed:
        raise typer.Exit(1)


def _print_check(result: Check) -> None:
    from rich.table import Table

    from twin.check import text_rows

    screen = console()
    head = ("mode", "f exact", "chain", "simulated", "zeta", "chain", "simulated", "1 - MAC")
    title = f"{result.rig}, {result.segments} segments: frequencies [Hz] and damping ratios [1]"
    modes = Table(*head, title=title, box=None, title_justify="left", title_style="")
    for row in text_rows(result):
        modes.add_row(*row)
    verdicts = Table("quantity", "error", "bound", "", "", box=None)
    for r in result.rows:
        verdicts.add_row(
            r.quantity, f"{r.error:.2g}", f"{r.bound:.2g}", r.unit, "ok" if r.passed else "FAILED"
        )
    screen.print(modes, highlight=False)
    screen.print()
    screen.print(verdicts, highlight=False)
    screen.print("passed" if result.passed else "failed")


# Shared by the commands


def console() -> Console:
    """Returns where results are printed: as wide as the terminal, or wide enough for the tables."""
    from rich.console import Console

    screen = Console()
    return screen if screen.is_terminal else Console(width=_WIDTH)


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Yields a function that says what is being done, on standard error and on a terminal only."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield lambda text: None
        return
    columns = (SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=screen, transient=True) as display:
        task = display.add_task("starting", total=None)
        yield lambda text: display.update(task, description=text)


if __name__ == "__main__":
    main()
