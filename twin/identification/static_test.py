"""The static test of a campaign: `static.csv`, loads beside the displacements or strains that they cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import g

from twin.campaigns.campaign import Campaign
from twin.identification.estimates import Estimate, student
from twin.identification.joint import prior_deviation
from twin.identification.static_line import LoadLine, fit_line, odd_row, resolution, stiffness

DISPLACEMENT = "tip_deflection"
LOADS = {"tip_force": 1.0, "tip_load_mass": g}
"""Columns that tell the load, with the force [N] of one unit of them."""


@dataclass(frozen=True)
class OddRow:
    """A row off the line through the others.

    Attributes:
      row: from 0.
      away: by which it lies off [m].
      others: what the others say.
      alone: EI [N m^2] of the row by itself, with the tare of the others; None without loads.
    """

    row: int
    away: float
    others: StaticTest
    alone: float | None


@dataclass(frozen=True)
class StaticTest:
    """What a static test says.

    Attributes:
      line: the line through it: displacement [m] over load [N], or over a reading of the gauge.
      column: the column on its x axis.
      errors: standard deviations of x and y, of which their ratio counts, units of the line; those of loads and
        displacements are as their last decimals, those of a gauge and displacements as their ranges.
      stiffness: EI [N m^2]; None without loads.
      modulus: E [Pa]; None where I is not given.
      curvature: w'' at the hub [1/m] for one unit of the gauge's column; None where loads are given.
      odd: the row that lies off the line through the others, if one does.
    """

    line: LoadLine
    column: str
    errors: tuple[float, float]
    stiffness: Estimate | None = None
    modulus: Estimate | None = None
    curvature: Estimate | None = None
    odd: OddRow | None = None

    @property
    def tare(self) -> float:
        """Load below none at which the line crosses zero displacement, units of x."""
        return self.line.intercept.value / self.line.slope.value


def read(campaign: Campaign) -> StaticTest | None:
    """Reads the static test; None where there is none, or without the displacement of the tip.

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

    def said(x: np.ndarray, y: np.ndarray) -> StaticTest:
        ratio = errors[0] / errors[1] if errors[1] > 0 else 0.0
        line = fit_line(x, y, ratio, steps=steps)
        if column not in LOADS:
            return StaticTest(line, column, errors, curvature=_curvature(line, length))
        found = stiffness(line, length)
        return StaticTest(line, column, errors, found, _modulus(found, table.second_moment))

    known = np.isfinite(x) & np.isfinite(y)
    return _with_odd_row(said(x[known], y[known]), said, length)


def _with_odd_row(
    found: StaticTest, said: Callable[[np.ndarray, np.ndarray], StaticTest], length: Estimate
) -> StaticTest:
    odd = odd_row(found.line)
    if odd is None:
        return found
    row, away = odd
    x, y = found.line.x, found.line.y
    others = said(np.delete(x, row), np.delete(y, row))
    alone = None
    if found.stiffness is not None and y[row] != 0:
        alone = float((x[row] + others.tare) * length.value**3 / (3 * y[row]))
    return replace(found, odd=OddRow(row, away, others, alone))


def _modulus(stiffness: Estimate, second_moment: float | None) -> Estimate | None:
    if second_moment is None:
        return None
    return stiffness.scaled(1 / second_moment)


def _curvature(line: LoadLine, length: Estimate) -> Estimate:
    """w'' at the hub [1/m] for one unit of the gauge: a force at the tip bends the link by w''(0) = 3 y/l^2."""
    bend = 3 / length.value**2
    value = bend * line.slope.value
    of_length = 2 * abs(value) * length.standard_error / length.value
    return student(value, bend * line.slope.standard_error, line.free, of_length)
