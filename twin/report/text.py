"""The summary of a diagnosis for the terminal: verdict, effects, errors, next experiment, written files."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING

from twin import labels
from twin.diagnosis.answer import Diagnosis
from twin.diagnosis.windows import WINDOW
from twin.report import display
from twin.report.prose import prose

if TYPE_CHECKING:
    from rich.console import Console, Group, RenderableType
    from rich.table import Table

_HEAD = 15
"""Longest line of a head of a table [characters]."""


def summary(diagnosis: Diagnosis, paths: Mapping[str, str | PathLike[str]] | None = None) -> str:
    """Returns the summary as plain text.

    Args:
      diagnosis: what is reported.
      paths: written files: label -> path, say "report" -> "out/report.html".
    """
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, width=110, force_terminal=False, color_system=None, emoji=False)
    print_summary(diagnosis, console, paths)
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def print_summary(
    diagnosis: Diagnosis, console: Console, paths: Mapping[str, str | PathLike[str]] | None = None
) -> None:
    """Prints verdict, effects, errors on held-out recordings, the next experiment, and where the files are.

    Args:
      diagnosis: what is reported.
      console: where to print; colours are used only where it has them.
      paths: written files: label -> path.
    """
    from rich.text import Text

    plain = console.options.ascii_only
    console.print(renderable(diagnosis, plain), highlight=False)
    if paths:
        console.print()
    width = max((len(label) for label in paths or ()), default=0)
    for label, path in (paths or {}).items():
        # Not wrapped, so that the path can be copied.
        line = Text.assemble((f"{label:<{width}}  ", "dim"), labels.printable(str(path), plain))
        console.print(line, soft_wrap=True, highlight=False)


def renderable(diagnosis: Diagnosis, plain: bool = False) -> Group:
    """Returns the summary for a rich console.

    Args:
      diagnosis: what is reported.
      plain: whether to use ASCII only.
    """
    from rich.console import Group
    from rich.text import Text

    def line(text: str, style: str = "") -> Text:
        return Text(labels.printable(text, plain), style=style)

    parts: list[RenderableType] = [line(f"{diagnosis.campaign}: {diagnosis.verdict}", "dim")]
    parts.append(line(display.headline(diagnosis), "bold"))
    parts += [line(diagnosis.summary)] if diagnosis.summary else []
    if diagnosis.effects:
        parts += [line(""), _effects_table(diagnosis, plain)]
    rows = display.budget_rows(diagnosis)
    if rows:
        what = "held-out recordings" if display.by_role(diagnosis, "holdout") else "fit recordings"
        title = f"Error on {what} in windows of {WINDOW:g} s; whole run and fit are of the final model"
        parts += [line(""), line(title, "dim")]
        parts.append(_budget_table(diagnosis, rows, plain))
    parts += [line(text) for text in _closing_lines(diagnosis)]
    return Group(*parts)


def _closing_lines(diagnosis: Diagnosis) -> list[str]:
    lines = []
    if diagnosis.depends_on and diagnosis.verdict == "outside-library":
        lines.append(f"What is unexplained {display.dependence(diagnosis)}")
    lines += [
        f"Not told apart: {', '.join(labels.words(name) for name in names)}"
        for names in diagnosis.indistinguishable
    ]
    if diagnosis.next_experiment:
        lines.append(f"Next: {prose(diagnosis.next_experiment)}")
    lines += [f"Note: {prose(note)}" for note in diagnosis.notes]
    return ["", *lines] if lines else []


def _effects_table(diagnosis: Diagnosis, plain: bool) -> Table:
    table = _table(plain, _gap(diagnosis), "effect added", "parameter", "value", "", "probability")
    for number, effect in enumerate(diagnosis.effects, start=1):
        rows = display.parameter_rows(effect) or [("", "", "", "")]
        for i, (name, value, unit, degrees) in enumerate(rows):
            beside = f"{unit} ({degrees})" if degrees else unit
            first = i == 0
            _add_row(
                table,
                plain,
                _numbered(diagnosis, number, labels.words(effect.name)) if first else "",
                name,
                value,
                beside,
                labels.probability(effect.probability) if first else "",
            )
    return table


def _numbered(diagnosis: Diagnosis, number: int, name: str) -> str:
    """An effect's name, with its number where there are several."""
    return f"{number} {name}" if _has_several(diagnosis) else name


def _gap(diagnosis: Diagnosis) -> int:
    """Characters between columns: with three effects, the tables fit into 80."""
    return 1 if _has_several(diagnosis) else 2


def _has_several(diagnosis: Diagnosis) -> bool:
    """Whether there are several effects: the columns of the budget have room for their numbers alone."""
    return len(diagnosis.effects) > 1


def _budget_table(diagnosis: Diagnosis, rows: Sequence[display.BudgetRow], plain: bool) -> Table:
    patch = [">with patch"] if any(row.patched for row in rows) else []
    before, calibrated, *steps = display.budget_columns(diagnosis)
    if _has_several(diagnosis):
        steps = [f"+ {number}" for number in range(1, len(steps) + 1)]
    models = [f">{name}" for name in (before, calibrated, *steps)]
    table = _table(plain, _gap(diagnosis), "recording", *models, ">whole run", *patch, ">fit %", ">noise")
    for row in rows:
        if row.first:
            _add_row(table, plain, row.file)
        channel = f" {row.channel}, {row.unit}{'' if row.in_windows else ' (whole run)'}"
        patched = [row.patched] if patch else []
        _add_row(table, plain, channel, *row.models, row.whole[1], *patched, row.fit[1], row.noise)
    return table


def _table(plain: bool, gap: int, *columns: str) -> Table:
    """An empty table with `gap` characters between columns, of which those that begin with > are numbers."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, gap, 0, 0), header_style="dim")
    for column in columns:
        right = column.startswith(">")
        label = "\n".join(textwrap.wrap(labels.printable(column.removeprefix(">"), plain), _HEAD))
        table.add_column(label, justify="right" if right else "left", no_wrap=right, overflow="fold")
    return table


def _add_row(table: Table, plain: bool, *cells: str) -> None:
    from rich.text import Text

    # Text, not str: a file name such as "[bold].csv" is no markup.
    table.add_row(*(Text(labels.printable(cell, plain)) for cell in cells))
