"""The command line: arguments in, text and exit code out. One function per command.

What the user gave and cannot be used ends in `Error: ...` and exit code 2. Heavy modules are imported where a
command needs them, so that help comes at once.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.errors import InputError

if TYPE_CHECKING:
    from twin.check import Check

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None
)

JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the result here.")]


def main() -> None:
    """Runs the command; 2 where its input cannot be used."""
    try:
        app()
    except InputError as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)


@app.callback()
def root() -> None:
    """A MuJoCo digital twin of a planar flexible manipulator that finds what its model lacks."""


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
    from rich.console import Console
    from rich.table import Table

    from twin.check import text_rows

    console = Console(highlight=False)
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
    console.print(modes)
    console.print()
    console.print(verdicts)
    console.print("passed" if result.passed else "failed")


# Shared by the commands


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Yields a function that says what is being done, on standard error and on a terminal only."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("starting") as status:
        yield status.update


def write_json(path: Path, content: Any) -> None:
    """Writes a result to the path that the user named.

    Raises:
      InputError: the path cannot be written.
    """
    try:
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error


if __name__ == "__main__":
    main()
