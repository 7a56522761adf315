"""The console of all commands: texts are shown literally, and in ASCII where it knows nothing else."""

from __future__ import annotations

from contextvars import ContextVar
from typing import Any

from rich.console import Console
from rich.text import Text

from twin.labels import printable
from twin.terminal import OutputLost

_QUIET = ContextVar("quiet", default=False)
_WIDTH = 110  # columns of output into a file or a pipe


def set_quiet(quiet: bool) -> None:
    """Says whether the command shows errors only."""
    _QUIET.set(quiet)


def is_quiet() -> bool:
    """Whether the command shows errors only."""
    return _QUIET.get()


class Screen(Console):
    """A console as wide as the terminal, else `_WIDTH` columns, on which "[red]" is a text and no colour."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)
        if not self.is_terminal:
            self.width = _WIDTH

    def render_str(self, text: str, **options: Any) -> Text:
        """Returns a text that the console can show; those in tables and titles come here, too."""
        return super().render_str(printable(text, self.options.ascii_only), **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Prints.

        Raises:
          OutputLost: the output cannot be written, or its reader has gone.
        """
        try:
            super().print(*objects, **options)
        except OSError as error:
            raise OutputLost(error) from error

    def on_broken_pipe(self) -> None:
        """Hands the error on, on which rich would end the process."""
        raise BrokenPipeError
