"""A validation in sentences and table rows, for terminal and page."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from twin import labels
from twin.validation.fleet import Outcome
from twin.validation.validation import CONFIDENCE, Driver, Validation, Verdict


def headline(result: Validation) -> str:
    """Returns controller, rig, and how many rigs keep every limit."""
    return (
        f"{result.job.controller} on {result.job.rig.name}, {result.job.scenario}: {result.kept} of "
        f"{len(result.outcomes)} rigs keep every limit, {100 * result.required:g} % have to.\n{all_rigs(result)}"
    )


def all_rigs(result: Validation) -> str:
    """Returns the share of all such rigs that keep every limit, and whether the nominal rig does."""
    low, high = result.interval
    nominal = "keeps" if result.keeps(result.nominal) else "does not keep"
    return (
        f"Of all such rigs {100 * low:.1f} to {100 * high:.1f} % do ({100 * CONFIDENCE:g} % confidence). "
        f"The nominal rig {nominal} them."
    )


def conclusion(result: Validation) -> str:
    """Returns the share of the rigs that keep every limit beside the one that was asked for."""
    share = 100 * result.kept / len(result.outcomes)
    asked = f"{share:.3g} % of rigs keep every limit; {100 * result.required:g} % were asked for"
    return (
        f"{asked}." if result.keeps(result.nominal) else f"{asked}, and the nominal rig does not keep them."
    )


def rows(result: Validation) -> Iterator[tuple[str, ...]]:
    """Yields requirement, limit, nominal, median and worst value, number of rigs that miss it, and its drivers."""
    for v in result.verdicts:
        sign = "≥" if v.requirement.at_least else "≤"
        figures = (v.nominal, float(np.median(v.values)), v.worst_value)
        yield (
            _name(v),
            f"{sign} {v.requirement.limit:g}{_unit(v)}",
            *(with_unit(v, value) for value in figures),
            str(v.failed) if v.failed else "none",
            ", ".join(driver(d) for d in v.drivers),
        )


def worst_cases(result: Validation) -> Iterator[str]:
    """Yields a line for each rig that is worst in a missed requirement: its metrics there, and their drivers."""
    missed = [v for v in result.verdicts if v.failed]
    for rig in dict.fromkeys(v.worst.drawn.number for v in missed):
        here = [v for v in missed if v.worst.drawn.number == rig]
        figures = ", ".join(f"{_name(v)} {with_unit(v, v.worst_value)}" for v in here)
        yield f"worst {figures}: rig {rig}, {_reason(result, here)}"


def _reason(result: Validation, verdicts: list[Verdict]) -> str:
    """The drivers of the metrics in the worst rig; without any, its parameters farthest from nominal."""
    worst = verdicts[0].worst
    names = dict.fromkeys(d.name for v in verdicts for d in v.drivers)
    if names:
        return ", ".join(f"{labels.parameter(name)} {value(result, worst, name)}" for name in names)
    return f"no parameter stands out over the fleet; farthest off: {', '.join(farthest(result, worst))}"


def farthest(result: Validation, outcome: Outcome, count: int = 3) -> list[str]:
    """Returns the parameters of a rig that are farthest from nominal, in standard deviations."""
    away = outcome.drawn.deviations
    names = sorted(away, key=lambda name: -abs(away[name]))[:count]
    return [f"{labels.parameter(name)} {value(result, outcome, name)}" for name in names]


def value(result: Validation, outcome: Outcome, name: str) -> str:
    """Returns a drawn parameter and its distance from nominal in standard deviations."""
    unknown = next(u for u in result.uncertain if u.name == name)
    away = outcome.drawn.deviations[name]
    unit = "" if unknown.unit == "1" else f" {labels.unit(unknown.unit)}"
    drawn = labels.number(unknown.value + away * unknown.deviation, labels.PAGE_DIGITS)
    return f"{drawn}{unit} ({labels.signed(away, 1)} σ)"


def remarks(result: Validation) -> Iterator[str]:
    """Yields what the margins refer to and leave out, or why there are none."""
    if result.no_margins:
        yield f"No margins can be given: the controller has no linear form; {result.no_margins}."
        return
    yield "Margins: of the loop broken at the torque, with the linearised chain, its hub sliding without dry friction."
    disks = (f"{number(m.disk)} with {modes}" for modes, m in result.by_modes.items())
    yield f"Disk margin of the nominal rig by bending modes of the modal model: {', '.join(disks)}."
    if result.left_out:
        yield f"Effects without linear form are left out: {', '.join(map(labels.words, result.left_out))}."


def driver(dependence: Driver) -> str:
    """Returns a parameter and its rank correlation."""
    return f"{labels.parameter(dependence.name)} {labels.signed(dependence.correlation, 2)}"


def number(metric: float) -> str:
    """Returns a metric with three digits; an infinite one, a settling time or margin, is "never"."""
    return "never" if math.isinf(metric) else labels.number(metric)


def with_unit(verdict: Verdict, metric: float) -> str:
    """Returns a metric with the unit of its requirement."""
    return number(metric) if math.isinf(metric) else f"{number(metric)}{_unit(verdict)}"


def _unit(verdict: Verdict) -> str:
    unit = labels.unit(verdict.requirement.unit)
    return unit if unit in ("", "°") else f" {unit}"


def _name(verdict: Verdict) -> str:
    return verdict.requirement.name.replace("_", " ")
