"""A correction without a cause: what a model leaves unexplained, as a smooth function of the variable it depends on.

It says what is left, where, and over which range that was seen; it explains nothing. As a lookup it can be added to a
model, marked as a patch: a torque on the hub (by angle, rate, time or command), or a change of a reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import make_smoothing_spline

from twin.errors import InputError, nearest
from twin.files.table import Table, read_table
from twin.mechanics.hub_law import HubLaw, HubTorque
from twin.recording import HUB_TORQUE, MEASURED

_ON_HUB = {"hub_angle": 1.0, "hub_rate": 2.0, "time": 3.0}
_ADDED, _SAMPLES = "added_to_", "samples"  # columns of its table
_BINS = 40
_FEW = 15  # samples below which a bin says nothing
_LEAST = 6  # points of a curve
_REPEATED = 2  # recordings in which a value of the variable must have been seen


@HubLaw
def lookup_torque(t, theta, omega, values):
    """Torque [N m] of a lookup: linear between its points, constant beyond them.

    Values are the variable (1 angle, 2 rate, 3 time), the number k of points, k values of the variable, k torques.
    """
    count = int(values[1])
    value = theta if values[0] == 1.0 else omega if values[0] == 2.0 else t
    if value <= values[2]:
        return values[2 + count]
    if value >= values[1 + count]:
        return values[1 + 2 * count]
    low, high = 0, count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if values[2 + middle] <= value:
            low = middle
        else:
            high = middle
    share = (value - values[2 + low]) / (values[2 + high] - values[2 + low])
    return values[2 + count + low] + share * (values[2 + count + high] - values[2 + count + low])


@dataclass(frozen=True, eq=False)
class Patch:
    """A lookup: linear between its points, constant beyond them.

    Attributes:
      channel: `hub_torque`, or the channel whose reading it changes.
      variable: on which it depends.
      x: (k) values of the variable, SI, ascending: the range in which it was seen.
      y: (k) what is added, in the unit of the channel (N m for the hub).
      count: (k) samples behind each point.
    """

    channel: str
    variable: str
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    count: np.ndarray = field(repr=False)

    def at(self, values: np.ndarray) -> np.ndarray:
        """What is added at values (m) of the variable."""
        return np.interp(values, self.x, self.y)

    def hub_torque(self) -> HubTorque | None:
        """The lookup as a torque on the hub; None where it is none, or goes by the command."""
        if self.channel != HUB_TORQUE or self.variable not in _ON_HUB:
            return None
        values = (_ON_HUB[self.variable], len(self.x), *self.x.tolist(), *self.y.tolist())
        return HubTorque("patch", lookup_torque, tuple(map(float, values)))

    @property
    def on_sensor(self) -> bool:
        """It changes a reading, not the torque on the hub."""
        return self.channel != HUB_TORQUE

    @property
    def allowed_variables(self) -> tuple[str, ...]:
        """What a simulation can look it up by."""
        return (*_ON_HUB, "torque_command") if self.channel == HUB_TORQUE else ("time", *MEASURED)

    @property
    def is_simulable(self) -> bool:
        """A simulation can look it up."""
        return self.variable in self.allowed_variables

    def on_command(self, torque: np.ndarray) -> np.ndarray:
        """Delivered torque (k) for a command (k) [N m]."""
        return (
            torque + self.at(torque)
            if self.channel == HUB_TORQUE and self.variable == "torque_command"
            else torque
        )

    def on_reading(self, time: np.ndarray, true: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Readings by channel (m) of true values, `time` (m) from the start of a recording."""
        known = {**true, "time": time}
        if self.channel not in true or self.variable not in known:
            return dict(true)
        return {**true, self.channel: true[self.channel] + self.at(known[self.variable])}


def to_csv(patch: Patch) -> str:
    """Returns the lookup as a table: the variable, what is added, both SI, and the samples behind each point."""
    rows = [f"{x:.9g},{y:.9g},{n:.0f}" for x, y, n in zip(patch.x, patch.y, patch.count, strict=True)]
    return "\n".join([f"{patch.variable},{_ADDED}{patch.channel},{_SAMPLES}", *rows]) + "\n"


def read_patch(path: Path) -> Patch:
    """Reads a lookup from a table as `to_csv` writes it; samples may be left out.

    Raises:
      InputError: it is none; the message names file, line or column, and what would be right.
    """
    table = read_table(path, path.name)
    added = [column for column in table.header if column.startswith(_ADDED)]
    variables = [column for column in table.header if column not in (*added, _SAMPLES)]
    if len(added) != 1 or len(variables) != 1:
        raise InputError(
            f"{path.name}, line 1: columns are {', '.join(table.header)}; expected a variable, {_ADDED}CHANNEL and, "
            f"at will, {_SAMPLES}, as in the patch.csv of a diagnosis"
        )
    x, y = table.columns[variables[0]], table.columns[added[0]]
    _check_points(path.name, table, x, y)
    count = table.columns.get(_SAMPLES, np.zeros(len(x)))
    found = Patch(added[0].removeprefix(_ADDED), variables[0], x, y, count)
    if found.channel not in (HUB_TORQUE, *MEASURED):
        raise InputError(
            f"{path.name}, line 1: nothing can be added to '{found.channel}'; expected one of: "
            f"{', '.join((HUB_TORQUE, *MEASURED))}{nearest(found.channel, (HUB_TORQUE, *MEASURED))}"
        )
    if not found.is_simulable:
        raise InputError(
            f"{path.name}, line 1: no simulation looks up {found.channel} by '{found.variable}'; expected one of: "
            f"{', '.join(found.allowed_variables)}{nearest(found.variable, found.allowed_variables)}"
        )
    return found


def _check_points(name: str, table: Table, x: np.ndarray, y: np.ndarray) -> None:
    if len(x) < 2:
        raise InputError(f"{name} has {len(x)} points after its header; expected at least 2")
    missing = np.flatnonzero(~np.isfinite(x + y))
    if missing.size:
        raise InputError(
            f"{name}, line {table.lines[missing[0]]}: a number is missing; expected one in each column"
        )
    back = np.flatnonzero(np.diff(x) <= 0)
    if back.size:
        before, after = x[back[0]], x[back[0] + 1]
        raise InputError(
            f"{name}, line {table.lines[back[0] + 1]}: {after:g} follows {before:g}; expected the variable to increase"
        )


def fit_lookup(
    left: np.ndarray, values: np.ndarray, recording: np.ndarray, channel: str, variable: str
) -> Patch | None:
    """Fits what is left of a channel as a smooth function of one variable.

    Means of bins, those seen in one recording only left out, joined by a smoothing spline whose stiffness generalised
    cross-validation chooses. Half of the bins' edges share out the samples, half the range: what happens seldom, at
    large values, is often what is wrong.

    Args:
      left: (n) what is unexplained, in the channel's unit.
      values: (n) of the variable.
      recording: (n) index of the recording of each sample.
      channel, variable: their names.

    Returns:
      The lookup; None where too little of the range was seen in more than one recording.
    """
    shares = np.linspace(0, 1, _BINS // 2 + 1)
    edges = np.unique([np.quantile(values, shares), values.min() + shares * np.ptp(values)])
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    needed = min(_REPEATED, len(np.unique(recording)))
    points = [
        _point(left[inside], values[inside])
        for inside in (bins == k for k in range(len(edges) - 1))
        if inside.sum() >= _FEW and len(np.unique(recording[inside])) >= needed
    ]
    if len(points) < _LEAST:
        return None
    x, y, count, variance = np.array(points).T
    x, keep = np.unique(x, return_index=True)
    if len(x) < _LEAST:
        return None
    weight = 1 / np.clip(variance[keep], 1e-2 * np.median(variance), 1e2 * np.median(variance))
    # Over the number of the bin and scaled: the spline's search for its stiffness is lost where points nearly coincide.
    scale, bin_number = max(float(np.abs(y).max()), 1e-30), np.arange(len(x), dtype=float)
    curve = make_smoothing_spline(bin_number, y[keep] / scale, weight / weight.max())
    return Patch(channel, variable, x, scale * curve(bin_number), count[keep])


def _point(left: np.ndarray, values: np.ndarray) -> tuple[float, float, int, float]:
    """Middle of a bin, its mean, its samples, and the variance of the mean."""
    return float(np.median(values)), float(left.mean()), len(left), float(left.var() / len(left))
