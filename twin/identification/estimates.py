"""What an identification says: plain values, read by the report, the JSON and the tests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.stats import t as students_t

Boundary = Literal["clamped", "free"]
IntervalBy = Literal["covariance", "profile", "range", "declaration"]
Kind = Literal["bending", "not bending", "unknown"]

EXPLAINED = 0.9
"""Share of what it balances that a balance has to explain to be believed."""
_UNTOLD = 0.5  # relative error from which a number is not given
TWO_SIDED_95 = 1.96
"""Standard errors to either side of a value that make a 95 % interval, where errors are normal."""


@dataclass(frozen=True)
class Estimate:
    """A number with its standard error, SI units.

    Attributes:
      value, standard_error: as they are called.
      profile: 95 % interval where errors are not normal: by the profile of the likelihood, or Student's where readings
        are few.
    """

    value: float
    standard_error: float
    profile: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        if self.profile is not None:
            return self.profile
        half = TWO_SIDED_95 * self.standard_error
        return self.value - half, self.value + half

    @property
    def told(self) -> bool:
        """Whether the error leaves something of the value."""
        return self.standard_error <= _UNTOLD * abs(self.value)

    def scaled(self, factor: float) -> Estimate:
        """The number in another unit, `factor` of which make one of its own; above zero."""
        profile = None if self.profile is None else (factor * self.profile[0], factor * self.profile[1])
        return Estimate(factor * self.value, factor * self.standard_error, profile)


def positive(value: float, standard_error: float) -> Estimate:
    """A number above zero with its standard error: an interval of its logarithm, which does not reach below zero."""
    factor = math.exp(TWO_SIDED_95 * standard_error / value)
    return Estimate(value, standard_error, (value / factor, value * factor))


def grown(estimate: Estimate, other: Estimate) -> Estimate:
    """A number whose error has that of something else in it, one standard error of which makes it the other one."""
    change = abs(estimate.value - other.value)
    error = math.hypot(estimate.standard_error, change)
    if estimate.profile is None:
        return Estimate(estimate.value, error)
    low, high = estimate.profile
    half = math.hypot((high - low) / 2, TWO_SIDED_95 * change)
    return Estimate(estimate.value, error, (estimate.value - half, estimate.value + half))


def student(value: float, scatter: float, free: int, known: float = 0.0) -> Estimate:
    """A number whose error was read off the scatter of few readings: an interval of Student's distribution.

    Args:
      value: the number.
      scatter: its standard error as the readings scatter.
      free: readings beyond those that the number and its companions take.
      known: another standard error, from elsewhere.
    """
    half = math.hypot(float(students_t.ppf(0.975, free)) * scatter, TWO_SIDED_95 * known)
    return Estimate(value, math.hypot(scatter, known), (value - half, value + half))


def disagreement(a: Estimate, b: Estimate) -> float:
    """Distance of two independent estimates in standard errors of their difference [1]."""
    return abs(a.value - b.value) / math.hypot(a.standard_error, b.standard_error)


def pooled(estimates: Sequence[Estimate]) -> Estimate:
    """The weighted mean of independent estimates; its error grows with their scatter (R. T. Birge, 1932).

    Raises:
      ValueError: there is none.
    """
    if not estimates:
        raise ValueError("no estimate to pool; expected at least one")
    values = np.array([e.value for e in estimates])
    weights = np.array([e.standard_error for e in estimates]) ** -2.0
    mean = float(weights @ values / weights.sum())
    ratio = 1.0
    if len(values) > 1:
        ratio = max(1.0, math.sqrt(weights @ (values - mean) ** 2 / (len(values) - 1)))
    return Estimate(mean, ratio / math.sqrt(weights.sum()))


@dataclass(frozen=True)
class Identified:
    """One parameter of the rig.

    Attributes:
      value, standard_error: the joint estimate, `unit`.
      unit: SI unit.
      declared: what the campaign says.
      declared_error: standard deviation of what it says; None where it says nothing.
      methods: procedure -> what it says by itself.
      profile: 95 % interval where errors are not normal.
      interval_by: what the interval is by: the covariance, the profile of the likelihood, the range that was looked at,
        which cuts it short, or the declaration, where the recordings say nothing.
    """

    value: float
    standard_error: float
    unit: str
    declared: float
    declared_error: float | None = None
    methods: Mapping[str, Estimate] = field(default_factory=dict)
    profile: tuple[float, float] | None = None
    interval_by: IntervalBy = "covariance"

    @property
    def estimate(self) -> Estimate:
        """Value with its error and interval."""
        return Estimate(self.value, self.standard_error, self.profile)


@dataclass(frozen=True)
class Mode:
    """A vibration seen in the recordings.

    Attributes:
      boundary: "clamped", or "free" where the hub can turn.
      frequency: [Hz].
      damping_ratio: [1].
      kind: "bending" where it is a bending mode of this rig, "not bending" where it is none.
      source: the recordings and the procedure.
    """

    boundary: Boundary
    frequency: Estimate
    damping_ratio: Estimate | None
    kind: Kind
    source: str


@dataclass(frozen=True)
class Finding:
    """What one procedure found, in sentences.

    Attributes:
      procedure: "static", "decay", "break-away", "coulomb", "inertia", "spectra", "against" or "joint".
      title: for people.
      sentences: what was found, and the evidence against it.
      missing: what the recordings lack for it; None where it was possible.
    """

    procedure: str
    title: str
    sentences: tuple[str, ...]
    missing: str | None = None


def mode_json(mode: Mode) -> dict[str, Any]:
    """The mode as plain values."""
    damping = mode.damping_ratio
    return {
        "boundary": mode.boundary,
        "frequency_hz": mode.frequency.value,
        "frequency_standard_error": mode.frequency.standard_error,
        "damping_ratio": None if damping is None else damping.value,
        "damping_standard_error": None if damping is None else damping.standard_error,
        "kind": mode.kind,
        "source": mode.source,
    }


def parameter_json(found: Identified) -> dict[str, Any]:
    """The parameter as plain values."""
    return {
        "value": found.value,
        "standard_error": found.standard_error,
        "interval": list(found.estimate.interval),
        "interval_by": found.interval_by,
        "unit": found.unit,
        "declared": found.declared,
        "methods": {
            name: {"value": e.value, "standard_error": e.standard_error, "interval": list(e.interval)}
            for name, e in found.methods.items()
        },
    }
