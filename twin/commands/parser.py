"""How the command line is parsed and its help is written, where typer's own way is not for users."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.core import TyperCommand

_WITHOUT_VALUE = {"--open": "report"}
"""Option that may stand without a value -> what that means."""


class Command(TyperCommand):
    """A command whose help and errors have no words of Python, and of whose options one may stand without a value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses the words of a command line; see `typer.core.TyperCommand`."""
        try:
            return super().parse_args(ctx, _completed(args))
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ")
            raise

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Writes arguments without their types, and limits in words."""
        for title, kind in (("Arguments", "argument"), ("Options", "option")):
            shown = [p.get_help_record(ctx) for p in self.get_params(ctx) if p.param_type_name == kind]
            rows = [_plain(*record) for record in shown if record is not None]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


def _completed(words: list[str]) -> list[str]:
    """Words with a value behind an option that stands at the end, or before another option."""
    found: list[str] = []
    for k, word in enumerate(words):
        found.append(word)
        alone = k + 1 == len(words) or words[k + 1].startswith("-")
        if alone and word in _WITHOUT_VALUE and "--" not in words[:k]:
            found.append(_WITHOUT_VALUE[word])
    return found


def _plain(name: str, text: str) -> tuple[str, str]:
    """A line of help: "FILE <list[Path]>" becomes "FILE", "x>=1" becomes "at least 1"."""
    return re.sub(r"^([^-\s]\S*) <.*>$", r"\1", name), re.sub(r"\bx>=", "at least ", text)
