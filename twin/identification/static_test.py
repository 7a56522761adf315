"""Evaluation of the static test of a campaign: `static.csv`, tip displacements beside loads or gauge readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g

from twin.campaigns.campaign import Campaign
from twin.identification.estimates import Estimate, student_t_estimate
from twin.identification.joint import prior_deviation
from twin.identification.static_line import LoadLine, fit_line, outlier, resolution, stiffness

DISPLACEMENT = "tip_deflection"
LOADS = {"tip_force": 1.0, "tip_load_mass": g}
"""Columns of a load -> force of one unit [N]."""


@dataclass(frozen=True)
class Outlier:
    """A row that lies off the line through the others.

    Attributes:
      row: its index, from 0.
      residual: its distance from that line [m].
      without: the evaluation of the other rows.
      own_stiffness: EI by this row alone, with the tare of the others [N m^2]; None without loads.
    """

    row: int
    residual: float
    without: StaticTest
    own_stiffness: float | None


@dataclass(frozen=True)
class StaticTest:
    """Result of a static test.

    Attributes:
      line: displacement [m] over load [N], or over a reading of the gauge.
      column: name of the column on the x axis.
      errors: standard deviations of x and y, only their ratio counts: for loads the rounding of both columns, for a
        gauge the standard deviations of both columns.
      stiffness: EI [N m^2]; None without loads.
      modulus: E [Pa]; None where the second moment of area is not given.
      curvature: w'' at the hub for one unit of the gauge's column [1/m]; None where loads are given.
      outlier: the row that lies off the line through the others; None without one.
    """

    line: LoadLine
    column: str
    errors: tuple[float, float]
    stiffness: Estimate | None = None
    modulus: Estimate | None = None
    curvature: Estimate | None = None
    outlier: Outlier | None = None

    @property
    def tare(self) -> float:
        """Load that was not recorded, by the intercept of the line, units of x."""
        return self.line.intercept.value / self.line.slope.value


def evaluate(campaign: Campaign) -> StaticTest | None:
    """Evaluates the static test of a campaign; None without one, or without tip displacements.

    Raises:
      InputError: there are too few rows, or the tip moves against its load.
    """
    table = campaign.static
    if table is None or DISPLACEMENT not in table:
        return None
    length = Estimate(campaign.rig["length"], prior_deviation(campaign.rig, "length"))
    others = [name for name in table.columns if name != DISPLACEMENT]
    column = next((name for name in LOADS if name in table), others[0] if others else None)
    if column is None:
        return None
    x, y = LOADS.get(column, 1.0) * table[column], table[DISPLACEMENT]
    steps = LOADS.get(column, 1.0) * resolution(table[column]), resolution(y)
    errors = steps if column in LOADS else (float(np.nanstd(x)), float(np.nanstd(y)))

    def through(x: np.ndarray, y: np.ndarray) -> StaticTest:
        ratio = errors[0] / errors[1] if errors[1] > 0 else 0.0
        line = fit_line(x, y, ratio, steps=steps)
        if column not in LOADS:
            return StaticTest(line, column, errors, curvature=_curvature(line, length))
        EI = stiffness(line, length)
        return StaticTest(line, column, errors, EI, _modulus(EI, table.second_moment))

    known = np.isfinite(x) & np.isfinite(y)
    return _with_outlier(through(x[known], y[known]), through, length)


def _with_outlier(
    whole: StaticTest, through: Callable[[np.ndarray, np.ndarray], StaticTest], length: Estimate
) -> StaticTest:
    """The test with its outlier, if there is one; `through` evaluates a set of rows."""
    found = outlier(whole.line)
    if found is None:
        return whole
    row, residual = found
    x, y = whole.line.x, whole.line.y
    without = through(np.delete(x, row), np.delete(y, row))
    own_stiffness = None
    if whole.stiffness is not None and y[row] != 0:
        own_stiffness = float((x[row] + without.tare) * length.value**3 / (3 * y[row]))
    return replace(whole, outlier=Outlier(row, residual, without, own_stiffness))


def _modulus(stiffness: Estimate, second_moment: float | None) -> Estimate | None:
    """Young's modulus E = EI/I [Pa]; None without the second moment of area [m^4]."""
    if second_moment is None:
        return None
    return stiffness.scaled(1 / second_moment)


def _curvature(line: LoadLine, length: Estimate) -> Estimate:
    """w'' at the hub [1/m] for one unit of the gauge: a force at the tip bends the link by w''(0) = 3 y/l^2."""
    bend = 3 / length.value**2
    value = bend * line.slope.value
    of_length = 2 * abs(value) * length.standard_error / length.value
    return student_t_estimate(value, bend * line.slope.standard_error, line.degrees_of_freedom, of_length)
