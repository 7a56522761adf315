"""Decision rules as data: statistic, limit, and the source of the limit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Source = Literal["derived", "measured", "assumed", "policy"]
"""Source of a limit: an equation; a benchmark; the practice of the field; a decision of the user or the authors."""

Trial = TypeVar("Trial")


@dataclass(frozen=True)
class Judgement:
    """Result of one rule for one trial.

    Attributes:
      rule: name of the rule.
      value: the statistic.
      limit: its limit.
      passed: whether the statistic is within the limit.
    """

    rule: str
    value: float
    limit: float
    passed: bool


@dataclass(frozen=True)
class Rule(Generic[Trial]):
    """A condition of the diagnosis.

    Attributes:
      name: identifies the rule in the answer.
      asks: the question that it answers.
      statistic: name of the statistic, with its unit.
      measure: the statistic of a trial.
      limit: the limit of a trial.
      limit_text: the limit in words.
      source: source of the limit.
      reference: equation, benchmark or literature.
      at_least: whether the statistic has to reach the limit; otherwise it must not exceed it.
      above: whether the statistic has to exceed the limit.
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
        """Compares the statistic of a trial with the limit."""
        value, limit = float(self.measure(trial)), float(self.limit(trial))
        passed = value > limit if self.above else value >= limit if self.at_least else value <= limit
        return Judgement(self.name, value, limit, passed)


def judge_all(rules: Sequence[Rule[Trial]], trial: Trial) -> tuple[Judgement, ...]:
    """The judgement of a trial by each rule."""
    return tuple(rule.judge(trial) for rule in rules)


def table_rows(rules: Sequence[Rule]) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, question, statistic with its limit, source and reference of each rule."""
    for rule in rules:
        sign = "" if rule.above else "at least " if rule.at_least else "at most "
        yield rule.name, rule.asks, f"{rule.statistic}: {sign}{rule.limit_text}", rule.source, rule.reference


def markdown(rules: Sequence[Rule]) -> str:
    """The rules as a Markdown table."""
    head = ("rule", "question", "statistic: limit", "source of the limit", "reference")
    rule = ("---",) * len(head)
    rows = ((f"`{name}`", *cells) for name, *cells in table_rows(rules))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))
