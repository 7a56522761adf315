"""A validation as one HTML page that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from twin import labels
from twin.files.whole import write_file
from twin.report import pages
from twin.report.pages import Cell, Row, Table
from twin.validation import pictures, text
from twin.validation.fleet import Outcome
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
    spreads, narrow = (pictures.spreads(result, columns) for columns in (4, 2))
    missing = [o for o in result.outcomes if not result.keeps(o)]
    return pages.render(
        "validation/page.html.j2",
        v=result,
        text=text,
        headline=_headline(result),
        caveat=_caveat(result),
        requirements=_requirements(result),
        missing=_missing(result, missing[:_MAX_LISTED]),
        more=max(len(missing) - _MAX_LISTED, 0),
        drawn=_drawn(result),
        runs=pages.figure(pictures.runs(result)),
        spreads=None if spreads is None else pages.figure(spreads, narrow),
    )


def _headline(result: Validation) -> str:
    return f"{result.job.controller} keeps every limit on {result.kept} of {len(result.outcomes)} rigs."


def _caveat(result: Validation) -> str:
    return f"{text.conclusion(result)} {text.all_rigs(result)}"


def _requirements(result: Validation) -> Table:
    rows: list[Row] = []
    for v, (name, limit, nominal, median, worst, failed, drivers) in zip(
        result.verdicts, text.rows(result), strict=True
    ):
        label = Cell(name, note=v.requirement.description)
        missed = Cell(failed, warns=v.failed > 0)
        rows.append((label, limit, nominal, median, worst, missed, drivers))
    columns = (
        "requirement",
        ">limit",
        ">nominal",
        ">median",
        ">worst",
        ">rigs that miss it",
        "driven by (rank correlation)",
    )
    return Table(columns, rows)


def _missing(result: Validation, outcomes: Sequence[Outcome]) -> Table:
    rows: list[Row] = []
    for o in outcomes:
        missed = [f"{labels.words(name)} {text.number(o.metrics[name])}" for name in result.missed(o)]
        away = ", ".join(text.farthest(result, o))
        rows.append((f"rig {o.drawn.number}", ", ".join(missed), away))
    return Table(("rig", "misses", "farthest from nominal"), rows)


def _drawn(result: Validation) -> Table:
    rows: list[Row] = [
        (
            labels.parameter(u.name),
            labels.number(u.value, labels.PAGE_DIGITS),
            labels.number(u.deviation, 2),
            labels.unit(u.unit),
        )
        for u in result.uncertain
    ]
    return Table(("parameter", ">nominal", ">standard deviation", "unit"), rows)
