"""The static test of a campaign: `static.csv`, loads beside the displacements or strains that they cause."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.constants import g

from twin.campaign import Campaign
from twin.identify.joint import prior_deviation
from twin.identify.load_line import LoadLine, fit_line, stiffness
from twin.identify.results import Estimate

DISPLACEMENT = "tip_deflection"
LOADS = {"tip_force": 1.0, "tip_load_mass": g}
"""Columns that tell the load, with the force [N] of one unit of them."""


@dataclass(frozen=True)
class StaticTest:
    """What a static test says.

    Attributes:
      line: the line through it: displacement [m] over load [N], or over a reading of the gauge.
      column: the column on its x axis.
      stiffness: EI [N m^2]; None without loads.
      curvature: w'' at the hub [1/m] for one unit of the gauge's column; None where loads are given.
    """

    line: LoadLine
    column: str
    stiffness: Estimate | None
    curvature: Estimate | None


def read(campaign: Campaign) -> StaticTest | None:
    """Reads the static test; None where there is none, or without the displacement of the tip.

    Raises:
      InputError: there are too few rows, or the tip moves against its load.
    """
    table = campaign.static
    if table is None or DISPLACEMENT not in table:
        return None
    length = Estimate(campaign.rig["length"], prior_deviation(campaign.rig, "length"))
    for column, force in LOADS.items():
        if column in table:
            line = fit_line(force * table[column], table[DISPLACEMENT])
            return StaticTest(line, column, stiffness(line, length), None)
    others = [name for name in table.columns if name != DISPLACEMENT]
    if not others:
        return None
    # Comb and gauge are both read: their errors are taken as alike in parts of their range.
    x, y = table[others[0]], table[DISPLACEMENT]
    line = fit_line(x, y, ratio=float(np.nanstd(x) / np.nanstd(y)))
    # A force at the tip bends the link by w''(0) = 3 y/l^2.
    bend = 3 / length.value**2
    relative = math.hypot(
        line.slope.standard_error / line.slope.value, 2 * length.standard_error / length.value
    )
    curvature = Estimate(bend * line.slope.value, abs(bend * line.slope.value) * relative)
    return StaticTest(line, others[0], None, curvature)
