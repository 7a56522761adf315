"""Validation of a controller: requirements checked on the nominal and on drawn rigs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.control import scenarios
from twin.control.experiment import LARGEST_SEED
from twin.correlations import Correlations
from twin.errors import InputError, checked_count
from twin.files.provenance import Provenance
from twin.validation.fleet import Evaluator, Job, Outcome, run_fleet
from twin.validation.margins import Margins
from twin.validation.requirements import LINEAR_METRICS, Requirement, Requirements
from twin.validation.rigs import INDEPENDENT, Effects, UncertainParameter, draw_rigs, uncertain_parameters

_MOST_RIGS = 100_000
"""Most rigs of a fleet: they take hours, and tell the share that fails within 0.3 %."""
CONFIDENCE = 0.95
"""Confidence of the interval of the share of rigs that keep every limit."""
_MAX_DRIVERS = 3  # parameters that are named for a metric
_MIN_CORRELATION = 0.25  # rank correlation from which a parameter counts as a driver [1]
_CHANCE_DEVIATIONS = 3.3
"""Standard errors 1/sqrt(N - 1) of a rank correlation that chance exceeds once in a thousand."""


@dataclass(frozen=True)
class Driver:
    """A parameter that a metric depends on.

    Attributes:
      name: of the uncertain parameter.
      correlation: Spearman's rank correlation of the metric with it over the fleet [1].
    """

    name: str
    correlation: float


@dataclass(frozen=True)
class Verdict:
    """One requirement over the fleet of N drawn rigs.

    Attributes:
      requirement: the limit.
      nominal: metric of the nominal rig.
      values: (N) metrics of the drawn rigs.
      worst: outcome of the drawn rig with the worst metric.
      drivers: parameters that the metric depends on, strongest first.
    """

    requirement: Requirement
    nominal: float
    values: np.ndarray = field(repr=False)
    worst: Outcome = field(repr=False)
    drivers: tuple[Driver, ...]

    @property
    def failed(self) -> int:
        """Number of drawn rigs that miss it."""
        return sum(not self.requirement.met(value) for value in self.values)

    @property
    def worst_value(self) -> float:
        """Metric of the worst rig."""
        return self.worst.metrics[self.requirement.name]


@dataclass(frozen=True)
class Validation:
    """Result of a validation.

    Attributes:
      job: controller, nominal rig, scenario.
      seed: of the random draw.
      effects: effects of the nominal rig.
      uncertain: parameters that are drawn.
      required: share of the drawn rigs that have to keep every limit [1].
      verdicts: one per requirement that could be checked.
      nominal: outcome of the nominal rig.
      outcomes: of the drawn rigs.
      no_margins: why the controller has no linear form; "" where it has one.
      by_modes: number of bending modes -> margins of the nominal rig; empty without a linear form.
      provenance: what it was computed with and from, or None if that was not recorded.
    """

    job: Job
    seed: int
    effects: Effects
    uncertain: tuple[UncertainParameter, ...]
    required: float
    verdicts: tuple[Verdict, ...]
    nominal: Outcome
    outcomes: tuple[Outcome, ...]
    no_margins: str
    by_modes: Mapping[int, Margins]
    provenance: Provenance | None = None

    def keeps(self, outcome: Outcome) -> bool:
        """Whether a rig keeps every limit."""
        return not self.missed(outcome)

    def missed(self, outcome: Outcome) -> list[str]:
        """Names of the limits that a rig misses."""
        limits = [v.requirement for v in self.verdicts]
        return [r.name for r in limits if not r.met(outcome.metrics[r.name])]

    @property
    def kept(self) -> int:
        """Number of drawn rigs that keep every limit."""
        return sum(map(self.keeps, self.outcomes))

    @property
    def passed(self) -> bool:
        """Whether the nominal rig and the required share of the drawn ones keep every limit."""
        return self.keeps(self.nominal) and self.kept >= self.required * len(self.outcomes)

    @property
    def interval(self) -> tuple[float, float]:
        """Exact binomial confidence interval of the share of rigs that keep every limit (Clopper and Pearson, 1934)."""
        from scipy.stats import binomtest

        interval = binomtest(self.kept, len(self.outcomes)).proportion_ci(CONFIDENCE, "exact")
        return float(interval.low), float(interval.high)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the linear loop does not contain."""
        return self.nominal.left_out


def validate(
    job: Job,
    effects: Effects,
    errors: Effects,
    requirements: Requirements,
    count: int,
    seed: int,
    report: Callable[[str], None],
    correlations: Correlations = INDEPENDENT,
    executor: Executor | None = None,
) -> Validation:
    """Checks the requirements on the nominal rig and on `count` drawn ones.

    Args:
      job: controller, nominal rig, scenario.
      effects: effects of the nominal rig.
      errors: standard errors of their parameters, SI.
      requirements: limits.
      count: number of rigs to draw.
      seed: of the draw.
      report: called with a text on the progress.
      correlations: of the errors of all parameters.
      executor: where the rigs run, see `run_fleet`.

    Raises:
      InputError: scenario, controller, count or seed cannot be used, or no parameter is uncertain.
    """
    checked_count("rigs", count, 1, _MOST_RIGS)
    checked_count("seed", seed, 0, LARGEST_SEED)
    _check_scenario(job.scenario)
    uncertain = uncertain_parameters(job.rig, effects, errors)
    if not uncertain:
        raise InputError(f"{job.rig.name}: no parameter has an uncertainty; expected one to draw rigs from")
    report("preparing the controller")
    bench = Evaluator(job)
    no_margins, by_modes = bench.no_form, bench.by_modes(job.rig, effects)
    drawn = draw_rigs(job.rig, effects, uncertain, count, seed, correlations)
    nominal, *outcomes = run_fleet(job, drawn, report, executor)
    limits = [r for r in requirements.limits.values() if not (no_margins and r.name in LINEAR_METRICS)]
    verdicts = tuple(_verdict(r, nominal, outcomes) for r in limits)
    share = requirements.share
    return Validation(
        job, seed, effects, uncertain, share, verdicts, nominal, tuple(outcomes), no_margins, by_modes
    )


def _check_scenario(name: str) -> None:
    """Raises InputError if the reference of a scenario does not come to rest."""
    chosen = scenarios.scenario(name)
    end, before = chosen.reference(chosen.duration), chosen.reference(chosen.duration - 1.0)
    if abs(end - before) > 0.01 * abs(end):
        raise InputError(
            f"the reference of {name} does not come to rest; expected a step, such as lq-step-120"
        )


def _verdict(requirement: Requirement, nominal: Outcome, outcomes: list[Outcome]) -> Verdict:
    values = np.array([o.metrics[requirement.name] for o in outcomes])
    worst = max(outcomes, key=lambda o: requirement.badness(o.metrics[requirement.name]))
    strongest = drivers(values, [o.drawn.deviations for o in outcomes])
    return Verdict(requirement, nominal.metrics[requirement.name], values, worst, strongest)


def drivers(values: np.ndarray, deviations: Sequence[Mapping[str, float]]) -> tuple[Driver, ...]:
    """Returns the parameters with a significant rank correlation with a metric, strongest first, at most three.

    Args:
      values: (N) metric of each rig; infinite ones have the highest rank.
      deviations: of each of the N rigs: name of an uncertain parameter -> deviation.
    """
    from scipy.stats import rankdata

    # A spread by rounding alone has no drivers.
    finite = values[np.isfinite(values)]
    if len(values) < 3 or len(finite) < 2 or np.ptp(finite) <= 1e-6 * np.abs(finite).max():
        return ()
    ranks = rankdata(values)
    correlations = [
        Driver(name, float(np.corrcoef(ranks, rankdata([away[name] for away in deviations]))[0, 1]))
        for name in deviations[0]
    ]
    least = max(_MIN_CORRELATION, _CHANCE_DEVIATIONS / np.sqrt(len(values) - 1))
    significant = [d for d in correlations if abs(d.correlation) >= least]
    strong = sorted(significant, key=lambda d: -abs(d.correlation))
    return tuple(strong[:_MAX_DRIVERS])


def to_json(validation: Validation) -> dict[str, Any]:
    """Returns the validation for a JSON file."""
    low, high = validation.interval
    return {
        "controller": validation.job.controller,
        "rig": validation.job.rig.name,
        "scenario": validation.job.scenario,
        "rigs": len(validation.outcomes),
        "seed": validation.seed,
        "passed": validation.passed,
        "kept": validation.kept,
        "kept_share": validation.kept / len(validation.outcomes),
        "kept_share_interval": [low, high],
        "required_share": validation.required,
        "margins": validation.no_margins == "",
        "no_margins_because": validation.no_margins or None,
        "margins_by_modes": {
            str(modes): {"growth_rate": m.growth, "gain_margin": m.gain, "phase_margin": m.phase}
            | {"disk_margin": m.disk}
            for modes, m in validation.by_modes.items()
        },
        "left_out_of_margins": list(validation.left_out),
        "uncertain": {
            u.name: {"value": u.value, "standard_deviation": u.deviation, "unit": u.unit}
            for u in validation.uncertain
        },
        "requirements": {v.requirement.name: _verdict_json(v) for v in validation.verdicts},
        "failed_rigs": [
            {"rig": o.drawn.number, "missed": validation.missed(o), "figures": dict(o.metrics)}
            | {"deviations": dict(o.drawn.deviations)}
            for o in validation.outcomes
            if not validation.keeps(o)
        ],
        "provenance": None if validation.provenance is None else validation.provenance.to_json(),
    }


def _verdict_json(verdict: Verdict) -> dict[str, Any]:
    r, values = verdict.requirement, verdict.values
    return {
        "limit": r.limit,
        "at_least": r.at_least,
        "unit": r.unit,
        "nominal": verdict.nominal,
        "median": float(np.median(values)),
        "failed": verdict.failed,
        "worst": {
            "rig": verdict.worst.drawn.number,
            "value": verdict.worst_value,
            "deviations": dict(verdict.worst.drawn.deviations),
        },
        "drivers": [{"parameter": d.name, "rank_correlation": d.correlation} for d in verdict.drivers],
    }
