"""The time column of a recording, checked alike for recordings of a campaign, runs, and whatever is compared."""

from __future__ import annotations

import math

import numpy as np

from twin.errors import InputError, exact, nearest, shown
from twin.files.table import Table
from twin.recording import SPARSEST

SHORTEST_PERIOD = 1e-5
"""Shortest accepted median sample period [s]: 100 kHz, a thousand samples in a period at 100 Hz, above which the link
has no mode that matters; a shorter one suggests a time in minutes, hours or days."""
_SHORTEST_SPAN = 0.1
"""Shortest accepted span [s]: one period at 10 Hz; a shorter one suggests a time in minutes or hours."""
LONGEST_PERIOD = 0.1
"""Longest accepted median sample period [s]: five samples per period at 2 Hz; a longer one suggests a time in ms."""
_ROUNDING = 1e-4  # of a period that is the difference of rounded instants [1]
_LONGEST_GAP = 86400.0
"""Longest accepted time between two samples [s], a day: an experiment takes minutes, a clock is set by years."""
_SHORT = 4.0
"""Time [s] that any recording counts as for `recording.SPARSEST`: a short one may have a long gap, in all 80 s."""

# Range of the first sample -> what counts so.
_EPOCHS = (
    (4.0e4, 5.5e4, "days, as spreadsheets count them"),
    (7.0e5, 7.7e5, "days, as MATLAB's datenum counts them"),
    (2.4e6, 2.5e6, "days, as Julian dates"),
    (1e12, 3e12, "milliseconds since 1970"),
    (1e15, 3e15, "microseconds since 1970"),
    (1e18, 3e18, "nanoseconds since 1970"),
)
_UNITS = {
    "seconds": 1.0,
    "milliseconds": 1e-3,
    "microseconds": 1e-6,
    "nanoseconds": 1e-9,
    "minutes": 60.0,
    "hours": 3600.0,
    "days": 86400.0,
}
_USUAL_PERIOD = 1e-3  # s


def checked_time(table: Table, column: str, unit: float = 1.0) -> np.ndarray:
    """Returns the instants of a table as measured, jitter and gaps included (n) [s].

    Args:
      table: the file.
      column: name of the column.
      unit: of its numbers [s].

    Raises:
      InputError: there are fewer than 2, one is missing, they do not increase, or they are no seconds of one recording.
    """
    if column not in table.header:
        hint = nearest(column, table.header) + table.note
        raise InputError(f"{table.top}: column '{column}' is missing; expected the time in s{hint}")
    time = table.columns[column]
    if len(time) < 2:
        after = " after its header" if table.rows == "line" else ""
        count = "one sample" if len(time) else "no samples"
        raise InputError(f"{table.name} has {count}{after}; expected at least 2")
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        raise InputError(f"{table.place(missing[0])}: {shown(column)} is missing; expected a number")
    _check_increase(table, column, time)
    time = unit * time
    _check_period(table, column, time, unit * float(table.columns[column][0]))
    _check_gaps(table, column, time)
    return time


def _check_increase(table: Table, column: str, time: np.ndarray) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if not back.size:
        return
    before, after = time[back[0]], time[back[0] + 1]
    few = after == before and np.median(np.diff(time)) == 0
    hint = "; its numbers have too few digits" if few else ""
    raise InputError(
        f"{table.place(back[0] + 1)}: {shown(column)} is {exact(after)} after {exact(before)}; "
        f"expected it to increase strictly{hint}"
    )


def _check_period(table: Table, column: str, time: np.ndarray, first: float) -> None:
    period = float(np.median(np.diff(time)))
    span = float(time[-1] - time[0])
    if period > LONGEST_PERIOD * (1 + _ROUNDING):
        found, bound = f"the samples are {period:.4g} s apart", f"at most {LONGEST_PERIOD:g} s"
    elif period < SHORTEST_PERIOD:
        found, bound = f"the samples are {period:.4g} s apart", f"at least {SHORTEST_PERIOD:g} s"
    elif span < _SHORTEST_SPAN:
        found, bound = f"the recording lasts {span:.4g} s", f"at least {_SHORTEST_SPAN:g} s"
    else:
        return
    suspicion = _suspicion(first, period)
    raise InputError(f"{table.name}: {found} by {shown(column)}; expected {bound}: {suspicion}")


def _suspicion(first: float, period: float) -> str:
    """A question about the unit of a time with an impossible period or span."""
    unit = next((name for low, high, name in _EPOCHS if low <= first <= high), None)
    if unit is None:
        unit = min(_UNITS, key=lambda name: abs(math.log(_UNITS[name] * period / _USUAL_PERIOD)))
        if unit == "seconds" or not SHORTEST_PERIOD <= _UNITS[unit] * period <= LONGEST_PERIOD:
            return "is it in s?"
    return f"is it in {unit}? Convert it to s"


def _check_gaps(table: Table, column: str, time: np.ndarray) -> None:
    gaps = np.diff(time)
    widest = int(np.argmax(gaps))
    sampled = max(len(time) * float(np.median(gaps)), _SHORT)
    if gaps[widest] <= _LONGEST_GAP and time[-1] - time[0] <= SPARSEST * sampled:
        return
    raise InputError(
        f"{table.place(widest + 1)}: {shown(column)} is {exact(time[widest + 1])} after "
        f"{exact(time[widest])}; expected one recording without such gaps: was a clock set, or the recording "
        "interrupted? Split the file there"
    )
