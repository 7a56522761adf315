"""The stiffness of the link from a static test: a straight line through loads and displacements, errors in both.

The clamped link bends under a force F at its tip by y = F l^3/(3 EI). A line with an intercept needs no tare, and
takes the zero of the ruler out; the reading divided by the load, row by row, has both in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from twin.errors import InputError
from twin.identification.estimates import Estimate, student

LEAST_ROWS = 3
_DOUBTFUL = 0.05  # probability below which a straight line is doubted


@dataclass(frozen=True)
class LoadLine:
    """A line y = intercept + slope x, with errors in x and y.

    Attributes:
      x, y: (n) what was measured.
      slope, intercept: with standard errors.
      free: rows beyond those that the line takes.
      scatter: standard deviation of y about the line, in units of y.
      curvature_probability: that a straight line scatters this much less under a parabola [1]; NaN below four rows.
    """

    x: np.ndarray
    y: np.ndarray
    slope: Estimate
    intercept: Estimate
    free: int
    scatter: float
    curvature_probability: float

    @property
    def straight(self) -> bool:
        """Whether a parabola explains the rows no better than chance would."""
        return not self.curvature_probability < _DOUBTFUL


def fit_line(
    x: np.ndarray,
    y: np.ndarray,
    ratio: float = 0.0,
    through_origin: bool = False,
    steps: tuple[float, float] = (0.0, 0.0),
) -> LoadLine:
    """Fits a line with errors in both variables, their sizes known as a ratio (W. E. Deming, 1943).

    Minimises sum (y - a - b x)^2/(1 + ratio^2 b^2).

    Args:
      x, y: (n) values; rows with a missing one are left out.
      ratio: standard deviation of x over that of y [x/y]; 0 for a least-squares line.
      through_origin: without an intercept.
      steps: to which x and y were rounded: few readings may lie on a line by luck.

    Raises:
      InputError: fewer than `LEAST_ROWS` rows, or all x alike.
    """
    known = np.isfinite(x) & np.isfinite(y)
    x, y = np.asarray(x, dtype=float)[known], np.asarray(y, dtype=float)[known]
    if len(x) < LEAST_ROWS:
        raise InputError(f"static.csv has {len(x)} complete rows; expected at least {LEAST_ROWS}")
    if np.ptp(x) == 0:
        raise InputError(f"static.csv: all loads are {x[0]:g}; expected different ones")
    x0, y0 = (0.0, 0.0) if through_origin else (x.mean(), y.mean())
    u, v = x - x0, y - y0
    slope = _slope(float(u @ u), float(v @ v), float(u @ v), ratio)
    intercept = y0 - slope * x0
    r = y - intercept - slope * x
    free = len(x) - (1 if through_origin else 2)
    rounded = math.hypot(steps[1], slope * steps[0]) / math.sqrt(12)
    scatter = max(math.sqrt(r @ r / free), rounded)
    # The noise of x shows in the scatter about the line too: scatter^2 = sigma_y^2 (1 + ratio^2 slope^2).
    spread = scatter / math.sqrt(u @ u)
    at_zero = 0.0 if through_origin else math.hypot(scatter / math.sqrt(len(x)), spread * x0)
    bent = math.nan if through_origin else _curvature_probability(x, y, float(r @ r))
    told = student(slope, spread, free), student(intercept, at_zero, free)
    return LoadLine(x, y, *told, free, scatter, bent)


def _slope(xx: float, yy: float, xy: float, ratio: float) -> float:
    if ratio == 0 or xy == 0:
        return xy / xx
    # The root of ratio^2 xy b^2 + (xx - ratio^2 yy) b - xy = 0 that has the sign of xy.
    gap = xx - ratio**2 * yy
    return 2 * xy / (gap + math.sqrt(gap**2 + 4 * ratio**2 * xy**2))


def _curvature_probability(x: np.ndarray, y: np.ndarray, straight: float) -> float:
    """Probability that chance alone makes a parabola this much better than a line (F test)."""
    free = len(x) - 3
    if free < 1:
        return math.nan
    z = (x - x.mean()) / np.ptp(x)
    r = y - np.polyval(np.polyfit(z, y, 2), z)
    bent = float(r @ r)
    if bent <= 1e-12 * float(y @ y):
        return 1.0 if straight <= 1e-12 * float(y @ y) else 0.0
    return float(f_distribution.sf((straight - bent) / (bent / free), 1, free))


def odd_row(line: LoadLine) -> tuple[int, float] | None:
    """The row (from 0) that lies off the line through the others, and by how much (units of y); None where none does.

    Off is three times their scatter, and at least the last decimal to which y was read.
    """
    found = []
    for k in range(len(line.x)):
        x, y = np.delete(line.x, k), np.delete(line.y, k)
        if len(x) > LEAST_ROWS and np.ptp(x) > 0:
            slope, intercept = np.polyfit(x, y, 1)
            scatter = float(np.std(y - intercept - slope * x, ddof=2))
            away = float(line.y[k] - intercept - slope * line.x[k])
            found.append((abs(away) / max(3 * scatter, 0.99 * resolution(line.y)), k, away))
    ratio, row, away = max(found, default=(0.0, 0, 0.0))
    return (row, away) if ratio > 1 else None


def resolution(values: np.ndarray) -> float:
    """The decimal step to which some readings were rounded; 0 where none is seen."""
    values = values[np.isfinite(values)]
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    steps = (10.0**e for e in range(math.ceil(math.log10(size)), math.floor(math.log10(size)) - 9, -1))
    return next((s for s in steps if np.allclose(values / s, np.round(values / s), rtol=0, atol=1e-6)), 0.0)


def stiffness(line: LoadLine, length: Estimate) -> Estimate:
    """EI = l^3/(3 slope) [N m^2] of a line of tip displacement [m] over force [N].

    Raises:
      InputError: the tip does not move with the force.
    """
    slope = line.slope.value
    if slope <= 0:
        raise InputError(
            f"static.csv: the tip moves by {slope:g} m/N under its load; expected a displacement "
            "in the direction of the load"
        )
    value = length.value**3 / (3 * slope)
    of_length = 3 * value * length.standard_error / length.value
    return student(value, value * line.slope.standard_error / slope, line.free, of_length)
