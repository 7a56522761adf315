"""Progress of long work, as a function that is told each stage."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]


def silent(text: str) -> None:
    """Says nothing."""
