"""Memory that is freed goes back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from functools import cache

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of malloc.h
_LARGE = 2**20
"""Bytes of an array of 130,000 numbers, four minutes on the grid of 2 ms: each costs a call of the system when it is
made and freed, which signals of shorter recordings do not."""
_KEPT = 2**26
"""Bytes of small arrays that are kept for the next ones: twice 32 MiB, the most that glibc keeps by itself. Once the
other limit is fixed, this one would be 128 KiB, and most arrays cost a call (man mallopt)."""


@cache  # once a process
def return_large_arrays() -> None:
    """Makes glibc give large arrays back to the system when they are freed; with another C library, does nothing.

    By itself it raises this limit with each array that is freed, up to 32 MiB, and keeps the holes that smaller ones
    leave: a diagnosis of ten minutes at 1 kHz took 2.2 GiB in place of 1.7, see benchmarks/results/growth.md.
    """
    # No such function, or, as in Windows, no library of the process.
    with suppress(AttributeError, OSError, TypeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGE)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)
