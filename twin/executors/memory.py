"""Memory that is freed goes back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of malloc.h
_LARGE = 2**20
"""Bytes of an array of 130,000 numbers: four minutes on the grid of 2 ms. Shorter recordings are as fast as without."""

_KEPT = 2**26
"""Bytes of small arrays that are kept for the next ones, the most that glibc keeps by itself."""


def return_large_arrays() -> None:
    """Makes glibc give large arrays back to the system when they are freed; with another C library, does nothing.

    By itself it raises this limit with each array that is freed, up to 32 MiB, and keeps the holes that smaller ones
    leave: a diagnosis of three minutes at 1 kHz then takes 750 MiB in place of 460.
    """
    # No such function, or, as in Windows, no library of the process.
    with suppress(AttributeError, OSError, TypeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _LARGE)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)
