"""Rules as data: what a rule measures, against which limit, and where the limit comes from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Source = Literal["derived", "measured", "assumed", "policy"]
"""Where a limit comes from: an equation; a benchmark; the field's practice; a decision of the user or of ours."""

Trial = TypeVar("Trial")


@dataclass(frozen=True)
class Judgement:
    """What one rule said.

    Attributes:
      rule: its name.
      value: the statistic.
      limit: what it was held against.
      passed: whether it keeps the limit.
    """

    rule: str
    value: float
    limit: float
    passed: bool


@dataclass(frozen=True)
class Rule(Generic[Trial]):
    """A condition of the diagnosis.

    Attributes:
      name: identifies it in the answer.
      asks: the question that it answers, for people.
      statistic: name of what it measures, with its unit.
      measure: the statistic of a trial.
      limit: what it is held against.
      limit_text: the limit in words.
      source: where the limit comes from.
      reference: equation, benchmark with its command, or literature.
      at_least: whether the statistic has to reach the limit; else it may not exceed it.
      above: whether it has to exceed the limit.
    """

    name: str
    asks: str
    statistic: str
    measure: Callable[[Trial], float]
    limit: Callable[[Trial], float]
    limit_text: str
    source: Source
    reference: str
    at_least: bool = True
    above: bool = False

    def judge(self, trial: Trial) -> Judgement:
        """Holds a trial against the limit."""
        value, limit = float(self.measure(trial)), float(self.limit(trial))
        passed = value > limit if self.above else value >= limit if self.at_least else value <= limit
        return Judgement(self.name, value, limit, passed)


def judge_all(rules: Sequence[Rule[Trial]], trial: Trial) -> tuple[Judgement, ...]:
    """The judgement of each rule."""
    return tuple(rule.judge(trial) for rule in rules)


def passes(judgements: Sequence[Judgement]) -> bool:
    """Whether all rules are kept."""
    return all(judgement.passed for judgement in judgements)


def table_rows(rules: Sequence[Rule]) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, question, statistic with its limit, source and reference of each rule."""
    for rule in rules:
        sign = "" if rule.above else "at least " if rule.at_least else "at most "
        yield rule.name, rule.asks, f"{rule.statistic}: {sign}{rule.limit_text}", rule.source, rule.reference
