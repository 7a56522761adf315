"""The answer over a fleet as one HTML page that needs no network, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from twin import labels
from twin.files.json import to_text
from twin.fleet import changes, text
from twin.fleet.answer import Fleet, RigAnswer, RigResult
from twin.fleet.store import FILES, FOLDER
from twin.fleet.stored import known
from twin.report import pages
from twin.report.deliver import FILES as RIG_FILES
from twin.report.pages import Cell, Row, Table
from twin.report.prose import prose


def deliver(fleet: Fleet, folder: Path) -> None:
    """Writes page and JSON into the folder of a fleet.

    Raises:
      InputError: it cannot be written.
    """
    FOLDER.write(folder, {FILES["page"]: render(fleet), FILES["answer"]: to_text(fleet.to_json())})


def render(fleet: Fleet) -> str:
    """Returns the page."""
    return pages.render(
        "fleet/page.html.j2",
        headline=text.headline(fleet),
        remarks=text.remarks(fleet),
        rigs=Table(text.COLUMNS, [_rig(r) for r in fleet.rigs]),
        effects=Table(("effect", ">rigs", "which"), list(text.effects(fleet))),
        values=Table(("rig", "effect", "parameter", ">value", "unit"), list(_values(fleet))),
        failures=Table(("rig", "folder", "why"), [(f.rig, str(f.campaign), f.error) for f in fleet.failures]),
        next=[(r.rig, prose(r.answer.next_experiment)) for r in fleet.answers if r.answer.next_experiment],
        provenance=fleet.provenance,
    )


def _rig(result: RigResult) -> Row:
    name, verdict, *others = text.row(result)
    if not isinstance(result, RigAnswer):
        return (name, Cell(verdict, warns=True), *others)
    report = f"{quote(result.folder.name)}/{RIG_FILES['report']}"
    missing = result.answer.verdict != "no-missing-effect"
    since = Cell(others.pop(), warns=bool(result.changes))
    return (Cell(name, link=report), Cell(verdict, strong=missing), *others, since)


def _values(fleet: Fleet) -> Iterator[Row]:
    """Yields the parameters of the adopted effects, with standard errors."""
    for rig in fleet.answers:
        for effect in rig.answer.effects:
            for name, value in effect.parameters.items():
                error = effect.standard_errors.get(name)
                shown = labels.with_error(known(value), error, labels.PAGE_DIGITS)
                unit = labels.unit(changes.unit(effect.name, name))
                yield rig.rig, labels.words(effect.name), labels.words(name), shown, unit
