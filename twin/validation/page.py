"""A validation as one HTML page that needs no network."""

from __future__ import annotations

from pathlib import Path

from twin.files.whole import write_file
from twin.report import pages
from twin.validation import pictures, text
from twin.validation.validation import Validation

_MAX_LISTED = 30  # rigs that miss a limit, in the table of the page


def write_page(result: Validation, path: Path) -> None:
    """Writes a validation as one HTML file; it is overwritten.

    Raises:
      InputError: the file cannot be written.
    """
    write_file(path, render(result))


def render(result: Validation) -> str:
    """Returns the page."""
    spreads = pictures.spreads(result)
    missing = [o for o in result.outcomes if not result.keeps(o)]
    return pages.render(
        "validation/page.html.j2",
        v=result,
        text=text,
        missing=[(o, result.missed(o), text.farthest(result, o)) for o in missing[:_MAX_LISTED]],
        more=max(len(missing) - _MAX_LISTED, 0),
        runs=pages.figure_html(pictures.runs(result), "runs"),
        spreads="" if spreads is None else pages.figure_html(spreads, "spreads"),
    )
