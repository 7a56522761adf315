"""Functions compiled by numba, kept on disk where there is a folder for that."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from multiprocessing import parent_process
from typing import Any

from numba import njit


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Returns a decorator: `numba.njit` with these options and a cache on disk.

    Without a folder that can be written, neither beside the function's file nor in the user's home, the function is
    compiled anew in each process, and a warning says what to do about it.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            _warn()
            return njit(**options)(function)

    return compiled


@cache  # once a process
def _warn() -> None:
    if parent_process() is None:  # which else has said it
        warnings.warn(
            "there is no folder in which compiled equations of motion can be kept, so that they are compiled each "
            "time; set NUMBA_CACHE_DIR to a folder that can be written",
            RuntimeWarning,
            stacklevel=2,
        )
