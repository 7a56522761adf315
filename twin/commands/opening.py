"""The option `--open`: shows the results of a diagnosis, in a browser or in the rerun viewer."""

from __future__ import annotations

import os
import subprocess
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer

from twin.commands.shared import require_display
from twin.errors import InputError

Opener = Annotated[
    Literal["report", "viewer"] | None,
    typer.Option(
        "--open",
        metavar="[report|viewer]",
        help="Show the report in the browser, or the recording in the rerun viewer; the report without a value.",
    ),
]
_ELSEWHERE = {
    "report": "leave --open out, and open report.html elsewhere",
    "viewer": "leave --open out, and open run.rrd elsewhere with `rerun FILE`",
}


def check_opener(opener: Literal["report", "viewer"] | None) -> None:
    """Checks that results can be shown, before the work begins.

    Raises:
      InputError: there is no display, no browser or no viewer.
    """
    if opener is None:
        return
    # $BROWSER may be one for a terminal.
    if opener == "viewer" or not os.environ.get("BROWSER"):
        require_display(f"--open {opener}", _ELSEWHERE[opener])
    if opener == "report":
        try:
            webbrowser.get()
        except webbrowser.Error:
            raise InputError(f"--open report found no browser; {_ELSEWHERE['report']}") from None
    else:
        _viewer()


def open_results(opener: Literal["report", "viewer"] | None, paths: Mapping[str, Path]) -> str:
    """Shows the report or the recording; returns a sentence where that failed, else "".

    Args:
      opener: which.
      paths: kind of file -> path, as of `twin.report.deliver`.
    """
    if opener == "report" and not webbrowser.open(paths["report"].resolve().as_uri()):
        return f"The browser did not open. Open {paths['report']} yourself."
    if opener == "viewer":
        command = [_viewer(), str(paths["rerun"])]
        nowhere = subprocess.DEVNULL
        subprocess.Popen(command, stdout=nowhere, stderr=nowhere, start_new_session=True)
    return ""


def _viewer() -> str:
    """The rerun viewer.

    Raises:
      InputError: it is not installed.
    """
    from twin.report.run_rerun import viewer_executable

    found = viewer_executable()
    if found is None:
        raise InputError(f"--open viewer found no program 'rerun' beside Python; {_ELSEWHERE['viewer']}")
    return found
