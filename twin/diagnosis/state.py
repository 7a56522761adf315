"""What the search came to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.diagnosis.candidates import Candidate
from twin.estimation.calibrate import Calibration
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.recording import HUB
from twin.residuals.data import DrivenData
from twin.rigs.patch import Patch


@dataclass(frozen=True)
class SearchState:
    """What the search came to, before any held-out recording is looked at.

    Attributes:
      start: the calibrated model from which the search started.
      adopted: candidates that were adopted, each on top of those before it.
      rounds: all candidates of each round, best first; the last one adopted nothing, unless the most were reached.
      thresholds: score that each round asked for.
      benches: the data as the calibrated model sees them, and then each that was adopted.
      by_chance: score that chance exceeds at the false-alarm rate, of each round.
      draws: scores that chance gives, of each round, see `twin.diagnosis.chance`.
      nameless: functions of one variable that may be behind what is left at the end, the likeliest first.
      taken_back: effects that were adopted, but only stand for something else together.
      instead: function without a name in the place of which the last effect was adopted, see
        `twin.diagnosis.rather_named`.
    """

    start: Calibration
    adopted: tuple[Candidate, ...]
    rounds: tuple[tuple[Candidate, ...], ...]
    thresholds: tuple[float, ...]
    benches: tuple[Workbench, ...]
    by_chance: tuple[float, ...] = ()
    draws: tuple[np.ndarray, ...] = ()
    nameless: tuple[UnnamedFunction, ...] = ()
    taken_back: tuple[str, ...] = ()
    instead: UnnamedFunction | None = None

    @property
    def names(self) -> list[str]:
        """Names of the adopted effects."""
        return [c.effects[-1] for c in self.adopted]

    @property
    def known(self) -> list[str]:
        """Names of the effects that the rig was declared with."""
        return list(self.start.declared.effects)

    @property
    def bench(self) -> Workbench:
        """The data as the model sees them that stands at the end of the search."""
        return self.benches[len(self.adopted)]

    @property
    def data(self) -> DrivenData:
        """The recordings of these, the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data

    @property
    def base(self) -> Fit:
        """The fit without any effect."""
        return self.start.base

    @property
    def best(self) -> Fit:
        """The fit of the model that stands at the end of the search."""
        return self.adopted[-1].fit if self.adopted else self.base


@dataclass(frozen=True)
class FunctionOf:
    """A torque on the hub that is a function of one variable.

    Attributes:
      variable: on which it depends.
      sided: whether it turns its sign with the hub's direction, as friction does.
      drive: whether it is a fault of the drive, which a sensor of its torque reads, too.
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
    """A function, and how much it explains of what a model leaves.

    Attributes:
      law: what it is a function of.
      evidence: how much more likely it makes the data, as a natural logarithm.
      by_chance: evidence that chance exceeds at the false-alarm rate, by any of the functions asked for.
      x: (k) values of the variable, SI, ascending.
      y: (k) the function there that corrects the model as it is fitted [N m].
      samples: (k) about each of them.
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
        return None if self.law.sided else Patch(HUB, self.law.variable, self.x, self.y, self.samples)
