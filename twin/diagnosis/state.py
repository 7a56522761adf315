"""What a search has come to: its rounds, the effects that they adopted, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement
from twin.estimation.calibrate import Calibration
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.recording import HUB_TORQUE
from twin.residuals.data import DrivenData
from twin.rigs.patch import Patch


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search: all candidates beside one model, and the one that was adopted, if any.

    Attributes:
      ranked: the candidates, best first.
      by_chance: score that the best candidate exceeds at the false-alarm rate where nothing is missing.
      threshold: score that was asked for.
      draws: scores of the permutation test (d), ascending, see `twin.diagnosis.chance`.
      judgements: candidate that was fitted -> its judgements by the rules of adoption.
      adopted: the adopted candidate, its fit that to `bench`; None where none was.
      bench: the data whitened for the adopted model.
    """

    ranked: tuple[Candidate, ...]
    by_chance: float = 0.0
    threshold: float = 0.0
    draws: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    judgements: Mapping[str, tuple[Judgement, ...]] = field(default_factory=dict)
    adopted: Candidate | None = None
    bench: Workbench | None = None

    def without_adoption(self) -> Round:
        """The same round as if it had adopted nothing."""
        return replace(self, adopted=None, bench=None)


@dataclass(frozen=True, eq=False)
class SearchState:
    """What a search has come to, before any held-out recording is looked at.

    Attributes:
      start: the calibrated model from which the search started.
      rounds: of the search; those that adopted an effect come first, one that adopted none may follow.
      unnamed: functions of one variable that may be behind what is left, the likeliest first.
      withdrawn: effects that were adopted and taken back, with the judgement that says why.
      instead: function without a name in whose place the last effect was adopted, see `twin.diagnosis.revise`.
    """

    start: Calibration
    rounds: tuple[Round, ...] = ()
    unnamed: tuple[UnnamedFunction, ...] = ()
    withdrawn: tuple[tuple[str, Judgement], ...] = ()
    instead: UnnamedFunction | None = None

    @property
    def adopting(self) -> tuple[Round, ...]:
        """The rounds that adopted an effect."""
        return tuple(r for r in self.rounds if r.adopted is not None)

    @property
    def adopted(self) -> tuple[Candidate, ...]:
        """The adopted candidates, each on top of those before it."""
        return tuple(r.adopted for r in self.rounds if r.adopted is not None)

    @property
    def last(self) -> Round | None:
        """The last round, if it adopted nothing."""
        return self.rounds[-1] if self.rounds and self.rounds[-1].adopted is None else None

    @property
    def names(self) -> list[str]:
        """Names of the adopted effects."""
        return [c.name for c in self.adopted]

    @property
    def known(self) -> list[str]:
        """Names of the effects that the rig was declared with."""
        return list(self.start.declared.effects)

    @property
    def gained(self) -> float:
        """Sum of the scores of the adopted effects."""
        return sum(c.score for c in self.adopted)

    @property
    def bench(self) -> Workbench:
        """The data whitened for the model that stands at the end."""
        return next((r.bench for r in reversed(self.rounds) if r.bench is not None), self.start.bench)

    @property
    def data(self) -> DrivenData:
        """The recordings of `bench`, the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data

    @property
    def base(self) -> Fit:
        """The fit without any adopted effect."""
        return self.start.base

    @property
    def best(self) -> Fit:
        """The fit of the model that stands at the end."""
        return self.adopted[-1].fit if self.adopted else self.base

    def with_round(self, more: Round) -> SearchState:
        """The state after one more round."""
        return replace(self, rounds=(*self.rounds, more))

    def with_last_fit(self, best: Fit) -> SearchState:
        """The state with another fit of the model that stands at its end."""
        if not self.adopted:
            return replace(self, start=replace(self.start, base=best))
        k = len(self.adopted) - 1
        adopted = replace(self.adopted[k], fit=best)
        changed = replace(self.rounds[k], adopted=adopted)
        return replace(self, rounds=(*self.rounds[:k], changed, *self.rounds[k + 1 :]))

    def with_adoptions(self, kept: Sequence[Round], reason: Mapping[str, Judgement]) -> SearchState:
        """The state with these adopting rounds alone; `reason` is why each of the other effects was withdrawn."""
        return replace(self, rounds=tuple(kept), withdrawn=(*self.withdrawn, *reason.items()))


@dataclass(frozen=True)
class FunctionOf:
    """What a torque on the hub without a name is a function of.

    Attributes:
      variable: on which it depends.
      sided: whether it changes its sign with the hub's direction, as friction does.
      drive: whether it is a fault of the drive, which a sensor of its torque reads too.
    """

    variable: str
    sided: bool = False
    drive: bool = False

    @property
    def variables(self) -> tuple[str, ...]:
        """On which it depends, its own first."""
        return (self.variable, "hub_rate") if self.sided else (self.variable,)


@dataclass(frozen=True, eq=False)
class UnnamedFunction:
    """A torque on the hub as a smooth function of one variable, and how much likelier it makes the recordings.

    Attributes:
      law: what it is a function of.
      evidence: log Bayes factor of the function against none.
      by_chance: evidence that chance exceeds at the false-alarm rate, by any of the functions asked for.
      x: (k) values of the variable, SI, ascending.
      y: (k) the function there that corrects the model as it is fitted [N m].
      samples: (k) number of samples about each of them.
    """

    law: FunctionOf
    evidence: float
    by_chance: float
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    samples: np.ndarray = field(repr=False)

    @property
    def lookup(self) -> Patch | None:
        """The function as a correction; None of one that a simulation cannot look up."""
        return None if self.law.sided else Patch(HUB_TORQUE, self.law.variable, self.x, self.y, self.samples)
