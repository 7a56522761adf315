"""Bending stiffness from a static test, by a straight line through loads and displacements with errors in both.

A force F at the tip bends the clamped link by y = F l^3/(3 EI). The intercept of the line absorbs the tare of the load
and the zero of the ruler, which a ratio y/F of each row contains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution
from scipy.stats import t as students_t

from twin.errors import InputError
from twin.identification.estimates import Estimate, student_t_estimate

MIN_ROWS = 3
"""Rows that a line with one degree of freedom needs."""
_OUTLIER_RATE = 0.01  # of tests without one in which a row is named [1]: as the false alarms of a diagnosis
_SIGNIFICANCE = 0.05  # of the F test of a parabola against a straight line [1]


@dataclass(frozen=True)
class LoadLine:
    """A line y = intercept + slope x, fitted with errors in x and y.

    Attributes:
      x, y: (n) measured values.
      slope, intercept: with standard errors and Student's t intervals.
      degrees_of_freedom: rows less unknowns.
      scatter: standard deviation of y about the line.
      curvature_probability: p-value of the F test of a parabola against the line [1]; NaN below four rows.
    """

    x: np.ndarray
    y: np.ndarray
    slope: Estimate
    intercept: Estimate
    degrees_of_freedom: int
    scatter: float
    curvature_probability: float

    @property
    def is_straight(self) -> bool:
        """Whether the F test does not prefer a parabola."""
        return not self.curvature_probability < _SIGNIFICANCE


def fit_line(
    x: np.ndarray,
    y: np.ndarray,
    ratio: float = 0.0,
    steps: tuple[float, float] = (0.0, 0.0),
) -> LoadLine:
    """Fits a line with errors in both variables of a known ratio (Deming regression; W. E. Deming, 1943).

    Minimises sum (y - a - b x)^2/(1 + ratio^2 b^2).

    Args:
      x, y: (n) values; rows with a missing one are left out.
      ratio: standard deviation of x over that of y [x/y]; 0 for a least-squares line.
      steps: rounding of x and y, the lower limit of the scatter: few readings may lie on a line by chance.

    Raises:
      InputError: fewer than `MIN_ROWS` rows, or all x equal.
    """
    known = np.isfinite(x) & np.isfinite(y)
    x, y = np.asarray(x, dtype=float)[known], np.asarray(y, dtype=float)[known]
    if len(x) < MIN_ROWS:
        raise InputError(f"static.csv has {len(x)} complete rows; expected at least {MIN_ROWS}")
    if np.ptp(x) == 0:
        raise InputError(f"static.csv: all loads are {x[0]:g}; expected different ones")
    x0, y0 = x.mean(), y.mean()
    u, v = x - x0, y - y0
    slope = _deming_slope(float(u @ u), float(v @ v), float(u @ v), ratio)
    intercept = y0 - slope * x0
    r = y - intercept - slope * x
    free = len(x) - 2
    rounded = math.hypot(steps[1], slope * steps[0]) / math.sqrt(12)
    scatter = max(math.sqrt(r @ r / free), rounded)
    # The scatter about the line contains the noise of x: scatter^2 = sigma_y^2 (1 + ratio^2 slope^2).
    slope_error = scatter / math.sqrt(u @ u)
    intercept_error = math.hypot(scatter / math.sqrt(len(x)), slope_error * x0)
    curvature = _curvature_probability(x, y, float(r @ r))
    estimates = (
        student_t_estimate(slope, slope_error, free),
        student_t_estimate(intercept, intercept_error, free),
    )
    return LoadLine(x, y, *estimates, free, scatter, curvature)


def _deming_slope(xx: float, yy: float, xy: float, ratio: float) -> float:
    """Slope b that minimises the sum of squares, from the centred second moments of x and y."""
    if ratio == 0 or xy == 0:
        return xy / xx
    # The root of ratio^2 xy b^2 + (xx - ratio^2 yy) b - xy = 0 that has the sign of xy.
    gap = xx - ratio**2 * yy
    return 2 * xy / (gap + math.sqrt(gap**2 + 4 * ratio**2 * xy**2))


def _curvature_probability(x: np.ndarray, y: np.ndarray, straight: float) -> float:
    """p-value of the F test of a parabola against a line whose sum of squared residuals is `straight`."""
    free = len(x) - 3
    if free < 1:
        return math.nan
    z = (x - x.mean()) / np.ptp(x)
    r = y - np.polyval(np.polyfit(z, y, 2), z)
    bent = float(r @ r)
    if bent <= 1e-12 * float(y @ y):
        return 1.0 if straight <= 1e-12 * float(y @ y) else 0.0
    return float(f_distribution.sf((straight - bent) / (bent / free), 1, free))


def outlier(line: LoadLine) -> tuple[int, float] | None:
    """The row (from 0) farthest off the line through the others, with its residual; None without an outlier.
    An outlier is off by more than the last decimal to which y was read, and by more than chance would set the farthest
    of so many rows off in one test of a hundred: a studentised deleted residual has Student's distribution
    (R. D. Cook and S. Weisberg, 1982).
    """
    candidates = []
    quantile = students_t.ppf(1 - _OUTLIER_RATE / (2 * len(line.x)), max(len(line.x) - 3, 1))
    for k in range(len(line.x)):
        x, y = np.delete(line.x, k), np.delete(line.y, k)
        if len(x) > MIN_ROWS and np.ptp(x) > 0:
            slope, intercept = np.polyfit(x, y, 1)
            scatter = float(np.std(y - intercept - slope * x, ddof=2))
            residual = float(line.y[k] - intercept - slope * line.x[k])
            leverage = 1 / len(x) + (line.x[k] - x.mean()) ** 2 / ((x - x.mean()) ** 2).sum()
            chance = quantile * scatter * math.sqrt(1 + leverage)
            candidates.append((abs(residual) / max(chance, 0.99 * resolution(line.y)), k, residual))
    ratio, row, residual = max(candidates, default=(0.0, 0, 0.0))
    return (row, residual) if ratio > 1 else None


def resolution(values: np.ndarray) -> float:
    """The power of ten to which all readings were rounded; 0 where they were not rounded to nine digits or fewer."""
    values = values[np.isfinite(values)]
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    steps = (10.0**e for e in range(math.ceil(math.log10(size)), math.floor(math.log10(size)) - 9, -1))
    return next((s for s in steps if np.allclose(values / s, np.round(values / s), rtol=0, atol=1e-6)), 0.0)


def stiffness(line: LoadLine, length: Estimate) -> Estimate:
    """Returns EI = l^3/(3 slope) [N m^2] of a line of tip displacement [m] over force [N].

    Raises:
      InputError: the slope is not positive.
    """
    slope = line.slope.value
    if slope <= 0:
        raise InputError(
            f"static.csv: the tip moves by {slope:g} m/N under its load; expected a displacement "
            "in the direction of the load"
        )
    value = length.value**3 / (3 * slope)
    of_length = 3 * value * length.standard_error / length.value
    return student_t_estimate(
        value, value * line.slope.standard_error / slope, line.degrees_of_freedom, of_length
    )
