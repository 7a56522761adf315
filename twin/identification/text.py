"""Estimates in words: value with interval, and whether two estimates agree."""

from __future__ import annotations

import math

from twin.identification.estimates import Estimate, normalised_difference

_MIN_DIGITS, _MAX_DIGITS = 4, 6
"""Significant digits of a printed value."""
DISAGREEMENT = 3.0
"""Normalised difference from which two estimates are said to disagree [1]."""


def format_estimate(estimate: Estimate, unit: str = "") -> str:
    """The value, its 95 % interval and unit: `0.2482 (0.2470 to 0.2494) N m^2`."""
    low, high = estimate.interval
    digits = _MIN_DIGITS
    if high > low and estimate.value:
        # One or two digits of half the interval.
        digits = min(
            max(_MIN_DIGITS, 1 + math.ceil(math.log10(2 * abs(estimate.value) / (high - low)))), _MAX_DIGITS
        )
    return f"{estimate.value:.{digits}g} ({low:.{digits}g} to {high:.{digits}g}) {unit}".rstrip()


def agreement(a: Estimate, b: Estimate, names: tuple[str, str]) -> str:
    """Whether two estimates of one quantity agree."""
    apart = normalised_difference(a, b)
    word = "agree" if apart < DISAGREEMENT else "disagree"
    return f"{names[0]} and {names[1]} {word}: {apart:.1f} standard errors of their difference apart."
