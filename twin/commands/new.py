"""`twin new`: a first campaign from unknown files."""

from __future__ import annotations

import os
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.commands.shared import JsonFile, console, progress
from twin.errors import InputError
from twin.files.json import write_json
from twin.files.outputs import check_writable

if TYPE_CHECKING:
    from twin.commands.screen import Screen
    from twin.proposal.propose import Proposal

_FILE = "campaign.toml"
_MOST_FILES = 1000


def new(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Recordings of one rig, in any format.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder of the campaign, new or empty, or that in which the files lie.",
            show_default="<folder of the files>-campaign",
        ),
    ] = None,
    json_file: JsonFile = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing; what is not known stays open.")] = False,
) -> None:
    """Look at unknown recordings and write a campaign.toml that says what they seem to hold."""
    folder = _folder(files, out)
    copies = _copies(files, folder)
    check_writable(json_file, made=folder, beside=(folder / _FILE, *copies.values()), read=files)
    with progress() as report:
        report("looking at the files")
        from twin.proposal.campaign_text import campaign_text, to_json
        from twin.proposal.propose import propose

        proposal = propose(files, folder.resolve().name)
        placed = [replace(entry, path=copies.get(entry.path, entry.path)) for entry in proposal.recordings]
        proposal = replace(proposal, recordings=tuple(placed))
    screen = console()
    _print(proposal, screen)
    if not (yes or screen.quiet) and screen.is_terminal and _can_answer():
        from twin.proposal.ask import complete

        proposal = complete(proposal, lambda question: _answer(screen, question))
    from twin.files.whole import write_new_files

    write_new_files(
        {**{target: source for source, target in copies.items()}, folder / _FILE: campaign_text(proposal)}
    )
    if json_file is not None:
        write_json(json_file, to_json(proposal))
    _print_next(proposal, folder, screen)


def _can_answer() -> bool:
    """Whether standard input is a terminal; Python has none where the command was started with it closed."""
    return sys.stdin is not None and sys.stdin.isatty()


def _folder(files: list[Path], out: Path | None) -> Path:
    """The folder of the campaign.

    Raises:
      InputError: a campaign or other files lie there, or there are too many files.
    """
    if len(files) > _MOST_FILES:
        raise InputError(f"{len(files)} files are named; expected at most {_MOST_FILES}")
    folder = Path(f"{files[0].resolve().parent.name or 'my-rig'}-campaign") if out is None else out
    if os.path.lexists(folder / _FILE):
        raise InputError(f"{folder} has a {_FILE}, which is not written over; name another folder with --out")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; expected a folder for the campaign, new or empty")
    return folder


def _copies(files: list[Path], folder: Path) -> dict[Path, Path]:
    """Files that do not lie in the folder of the campaign yet -> their places in it.

    Files of one name get that of their folder before it: "monday/run.csv" becomes "monday-run.csv".

    Raises:
      InputError: two files would have one name there, or a file in the folder has it.
    """
    from twin.campaigns.campaign import STATIC_FILE

    uses = Counter(file.name for file in files)
    taken: dict[str, Path] = {}
    copies: dict[Path, Path] = {}
    for file in files:
        home, name = file.resolve().parent, file.name
        if uses[name] > 1 and home != folder.resolve() and name != STATIC_FILE:
            name = f"{home.name}-{name}"
        if name in taken:
            raise InputError(f"{taken[name]} and {file} have the same name; expected another one for each")
        taken[name] = file
        if home != folder.resolve():
            copies[file] = folder / name
    for file, target in copies.items():
        if os.path.lexists(target):
            raise InputError(
                f"{target} exists, and {file} is not written over it; name another folder with --out"
            )
    return copies


def _answer(screen: Screen, question: str) -> str:
    """The user's answer; "" at the end of input."""
    try:
        return screen.input(question, markup=False)
    except EOFError:
        return ""


def _print(proposal: Proposal, screen: Screen) -> None:
    from rich.table import Table

    channels = Table("channel", "column", "unit", "gain", "why", box=None)
    for name, channel in proposal.channels.items():
        why = "; ".join(text for text in (channel.found.reason, channel.sign_reason) if text)
        gain = "" if channel.gain is None else f"{channel.gain:g}"
        channels.add_row(name, channel.found.column, channel.unit or "?", gain, why)
    recordings = Table("recording", "role", "hub", "start", "loop", "why", box=None)
    for entry in proposal.recordings:
        hub = "locked" if entry.clamped else "free"
        cells = ("", "", "", "") if entry.unusable else (entry.role, hub, entry.start, entry.loop)
        recordings.add_row(entry.path.name, *cells, entry.unusable or "; ".join(entry.reasons))
    for table in (channels, recordings):
        screen.print(table)
        screen.print()
    if proposal.unused:
        columns = (f"{column} ({what})" if what else column for column, what in proposal.unused.items())
        screen.print(f"Not used: {', '.join(columns)}")


def _print_next(proposal: Proposal, folder: Path, screen: Screen) -> None:
    from twin.proposal.campaign_text import needed

    screen.print(f"Written: {folder / _FILE}")
    if open_keys := needed(proposal):
        screen.print(f"Fill in there: {', '.join(open_keys)}")
    screen.print(f"Then: twin data {folder}")
