"""Progress of long computations, reported through a callback."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]
"""Is called with the name of each stage as it begins."""


def silent(text: str) -> None:
    """Reports nothing."""
