"""The validation of a controller: its fleet, judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.control import scenarios
from twin.correlations import Correlations
from twin.errors import InputError
from twin.validation.fleet import Bench, Job, Outcome, run_fleet
from twin.validation.loop import Margins
from twin.validation.requirements import LINEAR, Requirement, Requirements
from twin.validation.rigs import INDEPENDENT, Effects, Unknown, draw, unknowns

CONFIDENCE = 0.95
_DRIVERS = 3
_VISIBLE = 0.25  # rank correlation from which a parameter is said to drive a figure
_CHANCE = 3.3  # standard deviations, 1/sqrt(N - 1), of a rank correlation that is chance: one in a thousand


@dataclass(frozen=True)
class Driver:
    """A parameter that a figure depends on.

    Attributes:
      name: of the unknown.
      correlation: rank correlation (Spearman) of the figure with it over the fleet.
    """

    name: str
    correlation: float


@dataclass(frozen=True)
class Verdict:
    """One requirement over the fleet.

    Attributes:
      requirement: the limit.
      nominal: figure of the rig as believed.
      values: (N) figures of the drawn rigs.
      worst: outcome of the drawn rig that is worst in it.
      drivers: parameters that it depends on, strongest first.
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
        """Figure of the worst rig."""
        return self.worst.figures[self.requirement.name]


@dataclass(frozen=True)
class Validation:
    """A controller judged on its fleet.

    Attributes:
      job: controller, rig as believed, scenario.
      seed: of the fleet.
      effects: effects that act on the rig as believed.
      uncertain: what is drawn.
      required: share of the rigs that have to keep every limit.
      verdicts: one per requirement that could be judged.
      nominal: outcome of the rig as believed.
      outcomes: of the drawn rigs.
      no_margins: why the controller has no linear form; "" where it has one.
      by_modes: margins of the rig as believed by the number of bending modes; empty without a linear form.
    """

    job: Job
    seed: int
    effects: Effects
    uncertain: tuple[Unknown, ...]
    required: float
    verdicts: tuple[Verdict, ...]
    nominal: Outcome
    outcomes: tuple[Outcome, ...]
    no_margins: str
    by_modes: Mapping[int, Margins]

    def keeps(self, outcome: Outcome) -> bool:
        """Whether a rig keeps every limit."""
        return not self.missed(outcome)

    def missed(self, outcome: Outcome) -> list[str]:
        """Names of the limits that a rig misses."""
        limits = [v.requirement for v in self.verdicts]
        return [r.name for r in limits if not r.met(outcome.figures[r.name])]

    @property
    def kept(self) -> int:
        """Number of drawn rigs that keep every limit."""
        return sum(map(self.keeps, self.outcomes))

    @property
    def passed(self) -> bool:
        """Whether the rig as believed and the required share of the drawn ones keep every limit."""
        return self.keeps(self.nominal) and self.kept >= self.required * len(self.outcomes)

    @property
    def interval(self) -> tuple[float, float]:
        """Share of all such rigs that keep every limit, at `CONFIDENCE`: Clopper and Pearson, 1934."""
        from scipy.stats import binomtest

        found = binomtest(self.kept, len(self.outcomes)).proportion_ci(CONFIDENCE, "exact")
        return float(found.low), float(found.high)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects that the linear loop does not know."""
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
) -> Validation:
    """Judges a controller on the rig as believed and on `count` drawn ones.

    Args:
      job: controller, rig as believed, scenario.
      effects: effects that act on the rig.
      errors: standard errors of their parameters.
      requirements: limits.
      count: number of rigs to draw.
      seed: of the draw.
      report: told how far it is.
      correlations: of the errors of parameters, those of effects included.

    Raises:
      InputError: something of this cannot be used.
    """
    _check_scenario(job.scenario)
    uncertain = unknowns(job.rig, effects, errors)
    if not uncertain:
        raise InputError(f"{job.rig.name}: no parameter has an uncertainty; expected one to draw rigs from")
    report("preparing the controller")
    bench = Bench(job)
    no_margins, by_modes = bench.no_form, bench.by_modes(job.rig, effects)
    drawn = draw(job.rig, effects, uncertain, count, seed, correlations)
    nominal, *outcomes = run_fleet(job, drawn, report)
    limits = [r for r in requirements.limits.values() if not (no_margins and r.name in LINEAR)]
    verdicts = tuple(_verdict(r, nominal, outcomes) for r in limits)
    share = requirements.share
    return Validation(
        job, seed, effects, uncertain, share, verdicts, nominal, tuple(outcomes), no_margins, by_modes
    )


def _check_scenario(name: str) -> None:
    chosen = scenarios.scenario(name)
    end, before = chosen.reference(chosen.duration), chosen.reference(chosen.duration - 1.0)
    if abs(end - before) > 0.01 * abs(end):
        raise InputError(
            f"the reference of {name} does not come to rest; expected a step, such as lq-step-120"
        )


def _verdict(requirement: Requirement, nominal: Outcome, outcomes: list[Outcome]) -> Verdict:
    values = np.array([o.figures[requirement.name] for o in outcomes])
    worst = max(outcomes, key=lambda o: requirement.worse(o.figures[requirement.name]))
    found = drivers(values, [o.drawn.deviations for o in outcomes])
    return Verdict(requirement, nominal.figures[requirement.name], values, worst, found)


def drivers(values: np.ndarray, deviations: Sequence[Mapping[str, float]]) -> tuple[Driver, ...]:
    """Returns the parameters that a figure depends on by more than chance, strongest first, at most three.

    Args:
      values: (N) figure of each rig; infinite ones rank as such.
      deviations: N times name of an unknown -> deviation.
    """
    from scipy.stats import rankdata

    # Below what rounding and the sample period make of it, a figure says nothing.
    finite = values[np.isfinite(values)]
    if len(values) < 3 or len(finite) < 2 or np.ptp(finite) <= 1e-6 * np.abs(finite).max():
        return ()
    ranks = rankdata(values)
    found = [
        Driver(name, float(np.corrcoef(ranks, rankdata([away[name] for away in deviations]))[0, 1]))
        for name in deviations[0]
    ]
    visible = max(_VISIBLE, _CHANCE / np.sqrt(len(values) - 1))
    strong = sorted((d for d in found if abs(d.correlation) >= visible), key=lambda d: -abs(d.correlation))
    return tuple(strong[:_DRIVERS])


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
            {"rig": o.drawn.number, "missed": validation.missed(o), "figures": dict(o.figures)}
            | {"deviations": dict(o.drawn.deviations)}
            for o in validation.outcomes
            if not validation.keeps(o)
        ],
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
