"""Result types of an identification: estimates with standard errors, parameters, modes, findings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.stats import t as students_t

Boundary = Literal["clamped", "free"]
IntervalBy = Literal["covariance", "profile", "range", "declaration", "withheld"]
Kind = Literal["bending", "not bending", "unknown"]

MIN_DETERMINATION = 0.9
"""Coefficient of determination [1] below which the parameters of a balance are not used."""
_MAX_RELATIVE_ERROR = 0.5  # relative standard error [1] above which an estimate is not reported
TWO_SIDED_95 = 1.96
"""Half width of a 95 % interval in standard errors, for normal errors."""


@dataclass(frozen=True)
class Estimate:
    """A number with its standard error, SI units.

    Attributes:
      value, standard_error: in the same unit.
      profile: 95 % interval where errors are not normal: by the profile likelihood, or Student's t where there are few
        readings; None for a normal one.
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
    def informative(self) -> bool:
        """Whether the standard error is at most half of the value."""
        return self.standard_error <= _MAX_RELATIVE_ERROR * abs(self.value)

    def scaled(self, factor: float) -> Estimate:
        """Returns the estimate in another unit: value times `factor` (> 0)."""
        profile = None if self.profile is None else (factor * self.profile[0], factor * self.profile[1])
        return Estimate(factor * self.value, factor * self.standard_error, profile)


def positive_estimate(value: float, standard_error: float) -> Estimate:
    """Returns an estimate of a positive quantity, with the interval of a normal logarithm: it stays above zero."""
    factor = math.exp(TWO_SIDED_95 * standard_error / value)
    return Estimate(value, standard_error, (value / factor, value * factor))


def with_nuisance_error(estimate: Estimate, perturbed: Estimate) -> Estimate:
    """Adds the error that a nuisance parameter contributes to an estimate, in quadrature.

    Args:
      estimate: at the nuisance parameter's own value.
      perturbed: the same with the nuisance parameter one standard error larger.
    """
    change = abs(estimate.value - perturbed.value)
    error = math.hypot(estimate.standard_error, change)
    if estimate.profile is None:
        return Estimate(estimate.value, error)
    low, high = estimate.profile
    half = math.hypot((high - low) / 2, TWO_SIDED_95 * change)
    return Estimate(estimate.value, error, (estimate.value - half, estimate.value + half))


def student_t_estimate(value: float, scatter: float, free: int, known: float = 0.0) -> Estimate:
    """Returns an estimate whose standard error comes from few readings, with Student's t interval.

    Args:
      value: the estimate.
      scatter: its standard error by the scatter of the readings.
      free: degrees of freedom.
      known: independent standard error of known size, added in quadrature.
    """
    half = math.hypot(float(students_t.ppf(0.975, free)) * scatter, TWO_SIDED_95 * known)
    return Estimate(value, math.hypot(scatter, known), (value - half, value + half))


def normalised_difference(a: Estimate, b: Estimate) -> float:
    """Distance of two independent estimates in standard errors of their difference [1]."""
    return abs(a.value - b.value) / math.hypot(a.standard_error, b.standard_error)


def pooled(estimates: Sequence[Estimate]) -> Estimate:
    """Returns the weighted mean of independent estimates.

    Its standard error is multiplied by the Birge ratio where the estimates scatter more than their errors say
    (R. T. Birge, 1932).

    Raises:
      ValueError: no estimate is given.
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
    """One identified parameter of the rig or of a declared effect.

    Attributes:
      value, standard_error: final estimate, in `unit`.
      unit: SI unit.
      declared: value that the campaign declares.
      declared_error: standard deviation of the declared value; None where none is declared.
      methods: procedure -> its own estimate.
      profile: 95 % interval where errors are not normal.
      interval_by: source of the interval: the covariance, the profile likelihood, the bounds of the parameter, which
        truncate it, the declaration, where the recordings contain no information on it, or "withheld" where they
        contradict the model, standard errors and interval being NaN.
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
        """Value, standard error and interval."""
        return Estimate(self.value, self.standard_error, self.profile)


@dataclass(frozen=True)
class Mode:
    """A resonance found in the recordings.

    Attributes:
      boundary: "clamped", or "free" where the hub can turn.
      frequency: [Hz].
      damping_ratio: [1]; None where no mode could be fitted.
      kind: "bending" where the frequency is that of a bending mode of this rig, else "not bending".
      source: recordings and channel.
    """

    boundary: Boundary
    frequency: Estimate
    damping_ratio: Estimate | None
    kind: Kind
    source: str


@dataclass(frozen=True)
class Finding:
    """Result of one procedure in sentences.

    Attributes:
      procedure: "static", "decay", "break-away", "coulomb", "inertia", "spectra", "against" or "joint".
      title: heading of the section in the report.
      sentences: results, and how well they agree with other procedures.
      missing: which data the procedure would need; None where it was possible.
    """

    procedure: str
    title: str
    sentences: tuple[str, ...]
    missing: str | None = None


def mode_json(mode: Mode) -> dict[str, Any]:
    """Returns a mode as plain values for JSON."""
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


def interval_json(estimate: Estimate) -> list[float] | None:
    """Returns an interval as plain values for JSON; None where it is withheld."""
    return None if math.isnan(estimate.standard_error) else list(estimate.interval)


def parameter_json(parameter: Identified) -> dict[str, Any]:
    """Returns an identified parameter as plain values for JSON."""
    return {
        "value": parameter.value,
        "standard_error": parameter.standard_error,
        "interval": interval_json(parameter.estimate),
        "interval_by": parameter.interval_by,
        "unit": parameter.unit,
        "declared": parameter.declared,
        "methods": {
            name: {"value": e.value, "standard_error": e.standard_error, "interval": interval_json(e)}
            for name, e in parameter.methods.items()
        },
    }
