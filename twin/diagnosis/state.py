"""State of a search: its rounds, the effects that they adopted, and the test for unnamed functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin.diagnosis.candidates import Candidate
from twin.diagnosis.judgement import Judgement
from twin.diagnosis.rules import BEST
from twin.estimation.calibrate import Calibration
from twin.estimation.fit import Fit
from twin.estimation.output_error import OutputErrorData, driven_data
from twin.estimation.workbench import Workbench
from twin.recording import HUB_TORQUE
from twin.residuals.data import DrivenData
from twin.rigs.patch import Patch


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the search: all candidates beside one model, and the one that was adopted, if any.

    Attributes:
      ranked: the candidates, best first.
      by_chance: threshold of the permutation test at the false-alarm rate.
      threshold: score that an effect has to exceed: the largest of `by_chance` and the limits of the model error.
      draws: (d) scores of the permutation test, ascending, see `twin.diagnosis.permutation`.
      judgements: candidate -> its judgement by each rule.
      adopted: the adopted candidate, its fit that to `bench`; None where none was.
      bench: the data whitened for the adopted model.
      p_value: of the test by which a contradicted declaration was adopted; None where the scores decided.
    """

    ranked: tuple[Candidate, ...]
    by_chance: float = 0.0
    threshold: float = 0.0
    draws: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    judgements: Mapping[str, tuple[Judgement, ...]] = field(default_factory=dict)
    adopted: Candidate | None = None
    bench: Workbench | None = None
    p_value: float | None = None

    def without_adoption(self) -> Round:
        """The same round as if it had adopted nothing."""
        return replace(self, adopted=None, bench=None, p_value=None)

    def allows(self, candidate: Candidate) -> bool:
        """Whether a fitted candidate passed every rule of adoption in this round, that on its rank aside."""
        judged = self.judgements.get(candidate.name, ())
        return candidate.is_fitted and all(j.passed or j.rule == BEST.name for j in judged)


@dataclass(frozen=True, eq=False)
class SearchState:
    """State of a search; held-out recordings have no part in it.

    Attributes:
      start: the calibrated model from which the search started.
      rounds: of the search; those that adopted an effect come first, one that adopted none may follow.
      unnamed: smooth functions that were tested, the largest evidence first.
      withdrawn: effects that were adopted and withdrawn, with the judgement by which they were.
    """

    start: Calibration
    rounds: tuple[Round, ...] = ()
    unnamed: tuple[UnnamedFunction, ...] = ()
    withdrawn: tuple[tuple[str, Judgement], ...] = ()

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
    def undetermined(self) -> list[str]:
        """Effects that were withdrawn because the recordings do not determine their size."""
        return list(
            dict.fromkeys(n for n, judgement in self.withdrawn if judgement.rule == "size-is-determined")
        )

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
        """The data whitened for the final model."""
        return next((r.bench for r in reversed(self.rounds) if r.bench is not None), self.start.bench)

    @property
    def data(self) -> DrivenData:
        """The recordings of `bench`, the link driven by the measured hub angle."""
        return driven_data(self.bench)

    @property
    def on_output_errors(self) -> bool:
        """Whether `bench` holds output errors."""
        return isinstance(self.bench.data, OutputErrorData)

    @property
    def base(self) -> Fit:
        """The fit without any adopted effect."""
        return self.start.base

    @property
    def best(self) -> Fit:
        """The fit of the final model."""
        return self.adopted[-1].fit if self.adopted else self.base

    def with_round(self, more: Round) -> SearchState:
        """The state after one more round."""
        return replace(self, rounds=(*self.rounds, more))

    def with_last_fit(self, best: Fit, bench: Workbench | None = None) -> SearchState:
        """The state with another fit of the final model, to other data if a bench is given."""
        if not self.adopted:
            return replace(self, start=replace(self.start, base=best, bench=bench or self.start.bench))
        k = len(self.adopted) - 1
        adopted = replace(self.adopted[k], fit=best)
        changed = replace(self.rounds[k], adopted=adopted, bench=bench or self.rounds[k].bench)
        return replace(self, rounds=(*self.rounds[:k], changed, *self.rounds[k + 1 :]))

    def with_adoptions(self, kept: Sequence[Round], reason: Mapping[str, Judgement]) -> SearchState:
        """The state with these adopting rounds alone; `reason`: withdrawn effect -> the judgement by which it was."""
        return replace(self, rounds=tuple(kept), withdrawn=(*self.withdrawn, *reason.items()))


DRIVE, TIP = "drive", "tip_force"
"""Places where an unnamed function acts, beside the names of channels and parameters."""


@dataclass(frozen=True)
class FunctionOf:
    """Argument of an unnamed function, and where it acts.

    Attributes:
      variable: on which it depends.
      place: `HUB_TORQUE`: a torque on the hub; `DRIVE`: one that the motor torque sensor reads too; `TIP`: a force on
        the tip; a channel: an error of its reading; a parameter of the rig: a change of it.
      sided: whether it changes its sign with the direction of the hub, as friction.
    """

    variable: str
    place: str = HUB_TORQUE
    sided: bool = False

    @property
    def variables(self) -> tuple[str, ...]:
        """All variables on which it depends, `variable` first."""
        return (self.variable, "hub_rate") if self.sided else (self.variable,)


@dataclass(frozen=True, eq=False)
class UnnamedFunction:
    """A smooth function of one variable that the model lacks, with its evidence.

    Attributes:
      law: its argument, and where it acts.
      evidence: log Bayes factor of the function against none.
      by_chance: threshold of the largest evidence of all tested functions at the false-alarm rate.
      x: (k) values of the variable, SI, ascending.
      y: (k) the function that corrects the model as it is fitted, SI.
      samples: (k) number of samples nearest to each.
    """

    law: FunctionOf
    evidence: float
    by_chance: float
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    samples: np.ndarray = field(repr=False)

    @property
    def lookup(self) -> Patch | None:
        """The function as a correction of the torque on the hub; None if a simulation cannot evaluate it."""
        if self.law.sided or self.law.place not in (HUB_TORQUE, DRIVE):
            return None
        return Patch(HUB_TORQUE, self.law.variable, self.x, self.y, self.samples)
