"""Estimates in words: value with interval, and whether two estimates agree."""

from __future__ import annotations

import math

from twin import labels
from twin.identification.estimates import Estimate, normalised_difference

_MIN_DIGITS, _USUAL_DIGITS, _MAX_DIGITS = 4, 6, 9
"""Significant digits of a printed value: at least, at most as a rule, and at most where the interval is narrower."""
DISAGREEMENT = 3.0
"""Normalised difference from which two estimates are said to disagree [1]."""


def format_estimate(estimate: Estimate, unit: str = "") -> str:
    """The value, its 95 % interval and unit: `0.2482 (0.2470 to 0.2494) N·m²`."""
    low, high = estimate.interval
    value = labels.number(estimate.value, _digits(estimate.value, low, high))
    return f"{value} ({format_interval(estimate)}) {labels.unit(unit)}".rstrip()


def format_interval(estimate: Estimate) -> str:
    """The 95 % interval: `0.2470 to 0.2494`."""
    low, high = estimate.interval
    digits = _digits(estimate.value, low, high)
    return f"{labels.number(low, digits)} to {labels.number(high, digits)}"


def with_half_interval(estimate: Estimate) -> str:
    """The value with half of its 95 % interval, `0.2482 ± 0.0012`; the value alone where that is withheld."""
    low, high = estimate.interval
    return labels.with_error(estimate.value, (high - low) / 2, labels.PAGE_DIGITS)


def _digits(value: float, low: float, high: float) -> int:
    """Significant digits: one or two of half the interval."""
    if not (high > low and value):
        return _MIN_DIGITS
    digits = max(_MIN_DIGITS, 1 + math.ceil(math.log10(2 * abs(value) / (high - low))))
    coincide = f"{low:.{_USUAL_DIGITS}g}" == f"{high:.{_USUAL_DIGITS}g}"
    return min(digits, _MAX_DIGITS if coincide else _USUAL_DIGITS)


def agreement(a: Estimate, b: Estimate, names: tuple[str, str]) -> str:
    """Whether two estimates of one quantity agree."""
    apart = normalised_difference(a, b)
    word = "agree" if apart < DISAGREEMENT else "disagree"
    return f"{names[0]} and {names[1]} {word}: {apart:.1f} standard errors of their difference apart."
