"""Empirical lookup table of the remaining residual: a smooth function of one variable, without a physical explanation.

It has the size of the residual and the range of the variable over which it was observed. As a patch it can be added to
a model: a torque on the hub as a function of hub angle, rate, time or command, or a change of a reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import make_smoothing_spline

from twin.errors import InputError, checked_number, exact, listed, nearest, quoted
from twin.files.table import Table, read_table
from twin.mechanics.hub_law import HubLaw, HubTorque
from twin.parameters import PARAMETERS
from twin.recording import HUB_TORQUE, MEASURED

_HUB_VARIABLES = {"hub_angle": 1.0, "hub_rate": 2.0, "time": 3.0}
"""Variables of a patch on the hub torque -> their code among the values of `lookup_torque`."""
_ADDED, _SAMPLES = "added_to_", "samples"
"""Columns of the CSV table: prefix of a channel, and number of samples."""
_LARGEST = PARAMETERS["static_friction"][1][1]  # N m, torque that a rig can have on its hub
_BINS = 40  # bins of the variable, at most
_FEWEST_IN_BIN = 4  # samples, or 32 ms: longer than the 20 ms over which the low-pass makes them alike
_FEWEST_POINTS = 6  # points of a curve; with fewer there is none
_REPEATED = 2  # recordings that a bin must have samples of, so that it is no peculiarity of one


@HubLaw
def lookup_torque(t, theta, omega, values):
    """Torque [N m] of a lookup table: linear between its points, constant beyond them.

    `values` are the code of the variable (1 angle, 2 rate, 3 time), the number of points k, k values of the variable in
    ascending order, k torques.
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
    """A lookup table: linear between its points, constant beyond them.

    Attributes:
      channel: `hub_torque`, or the channel whose reading it changes.
      variable: name of the variable on which it depends.
      x: (k) values of the variable, SI, ascending: the observed range.
      y: (k) added values, in the unit of the channel (N m for the hub torque).
      count: (k) number of samples of which each point is the mean.
    """

    channel: str
    variable: str
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    count: np.ndarray = field(repr=False)

    def at(self, values: np.ndarray) -> np.ndarray:
        """Returns the added value at values (m) of the variable."""
        return np.interp(values, self.x, self.y)

    def hub_torque(self) -> HubTorque | None:
        """The table as a torque on the hub; None where it changes a reading, or depends on the command."""
        if self.channel != HUB_TORQUE or self.variable not in _HUB_VARIABLES:
            return None
        values = (_HUB_VARIABLES[self.variable], len(self.x), *self.x.tolist(), *self.y.tolist())
        return HubTorque("patch", lookup_torque, tuple(map(float, values)))

    @property
    def on_sensor(self) -> bool:
        """Whether it changes a reading instead of the torque on the hub."""
        return self.channel != HUB_TORQUE

    @property
    def allowed_variables(self) -> tuple[str, ...]:
        """Variables on which a patch of this channel may depend in a simulation."""
        if self.channel == HUB_TORQUE:
            return (*_HUB_VARIABLES, "torque_command")
        # Few rigs read the rate: a simulation of another has only the angle.
        return ("time", *(channel for channel in MEASURED if channel != "hub_rate"))

    @property
    def is_simulable(self) -> bool:
        """Whether a simulation has the variable on which it depends."""
        return self.variable in self.allowed_variables

    def on_command(self, torque: np.ndarray) -> np.ndarray:
        """Returns the torque (k) [N m] with the patch added where it depends on the command (k)."""
        return (
            torque + self.at(torque)
            if self.channel == HUB_TORQUE and self.variable == "torque_command"
            else torque
        )

    def on_reading(self, time: np.ndarray, true: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Returns readings by channel (m) of true values, SI; `time` (m) [s] from the start of a recording."""
        known = {**true, "time": time}
        if self.channel not in true or self.variable not in known:
            return dict(true)
        return {**true, self.channel: true[self.channel] + self.at(known[self.variable])}


def to_csv(patch: Patch) -> str:
    """Returns the patch as CSV: variable, added value, both SI, and number of samples of each point."""
    rows = [f"{x:.9g},{y:.9g},{n:.0f}" for x, y, n in zip(patch.x, patch.y, patch.count, strict=True)]
    return "\n".join([f"{patch.variable},{_ADDED}{patch.channel},{_SAMPLES}", *rows]) + "\n"


def read_patch(path: Path) -> Patch:
    """Reads a patch from a CSV file as `to_csv` writes it; the column of samples may be missing.

    Raises:
      InputError: the file is no such table, or no simulation can apply it.
    """
    table = read_table(path, path.name)
    added = [column for column in table.header if column.startswith(_ADDED)]
    variables = [column for column in table.header if column not in (*added, _SAMPLES)]
    if len(added) != 1 or len(variables) != 1:
        raise InputError(
            f"{path.name}, line 1: columns are {listed(table.header)}; expected a variable, {_ADDED}CHANNEL and, "
            f"at will, {_SAMPLES}, as in the patch.csv of a diagnosis"
        )
    x, y = table.columns[variables[0]], table.columns[added[0]]
    _check_points(path.name, table, x, y)
    count = table.columns.get(_SAMPLES, np.zeros(len(x)))
    patch = Patch(added[0].removeprefix(_ADDED), variables[0], x, y, count)
    if patch.channel not in (HUB_TORQUE, *MEASURED):
        raise InputError(
            f"{path.name}, line 1: nothing can be added to {quoted(patch.channel)}; expected one of: "
            f"{', '.join((HUB_TORQUE, *MEASURED))}{nearest(patch.channel, (HUB_TORQUE, *MEASURED))}"
        )
    if not patch.on_sensor:
        for line, torque in zip(table.lines, y, strict=True):
            checked_number(f"{path.name}, line {line}: {added[0]}", float(torque), -_LARGEST, _LARGEST, "N*m")
    if not patch.is_simulable:
        raise InputError(
            f"{path.name}, line 1: no simulation looks up {patch.channel} by {quoted(patch.variable)}; "
            f"expected one of: {', '.join(patch.allowed_variables)}{nearest(patch.variable, patch.allowed_variables)}"
        )
    return patch


def _check_points(name: str, table: Table, x: np.ndarray, y: np.ndarray) -> None:
    """Raises InputError where a patch has fewer than 2 points, a missing number, or an x that does not increase."""
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
            f"{name}, line {table.lines[back[0] + 1]}: {exact(after)} follows {exact(before)}; "
            "expected the variable to increase"
        )


def fit_lookup(
    residual: np.ndarray, values: np.ndarray, recording: np.ndarray, channel: str, variable: str
) -> Patch | None:
    """Fits the remaining residual of a channel by a smooth function of one variable.

    A smoothing spline through the means of bins; its parameter is from generalised cross-validation. Bins with
    samples of one recording only are omitted. Half of the bin edges are quantiles, half are evenly spaced, because
    residuals are often large at values of the variable that are rare.

    Args:
      residual: (n) what the model lacks and the patch shall add, in the channel's unit.
      values: (n) of the variable.
      recording: (n) index of the recording of each sample.
      channel, variable: their names.

    Returns:
      The patch; None where too few bins have samples of several recordings.
    """
    shares = np.linspace(0, 1, _BINS // 2 + 1)
    edges = np.unique([np.quantile(values, shares), values.min() + shares * np.ptp(values)])
    bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    needed = min(_REPEATED, len(np.unique(recording)))
    points = [
        _point(residual[inside], values[inside])
        for inside in (bins == k for k in range(len(edges) - 1))
        if inside.sum() >= _FEWEST_IN_BIN and len(np.unique(recording[inside])) >= needed
    ]
    if len(points) < _FEWEST_POINTS:
        return None
    x, y, count, variance = np.array(points).T
    x, keep = np.unique(x, return_index=True)
    if len(x) < _FEWEST_POINTS:
        return None
    weight = 1 / np.clip(variance[keep], 1e-2 * np.median(variance), 1e2 * np.median(variance))
    # Fitted over the bin's number, with y scaled: cross-validation fails where points nearly coincide.
    scale, bin_number = max(float(np.abs(y).max()), 1e-30), np.arange(len(x), dtype=float)
    curve = make_smoothing_spline(bin_number, y[keep] / scale, weight / weight.max())
    return Patch(channel, variable, x, scale * curve(bin_number), count[keep])


def _point(residual: np.ndarray, values: np.ndarray) -> tuple[float, float, int, float]:
    """Returns median of the variable in a bin, mean of the residual, number of samples, and variance of that mean."""
    return (
        float(np.median(values)),
        float(residual.mean()),
        len(residual),
        float(residual.var() / len(residual)),
    )
