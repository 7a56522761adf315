"""Marks of some cases of a test."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def slow_except(cases: Iterable[Any], *quick: Any) -> list[Any]:
    """The cases, marked slow but for these: they stand for the others in the fast run."""
    return [case if case in quick else pytest.param(case, marks=pytest.mark.slow) for case in cases]
