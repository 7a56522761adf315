"""What a diagnosis says: plain values, read by the report, the JSON and the tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from twin.correlations import Correlations
from twin.diagnosis.judgement import Judgement
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS, Recording
from twin.rigs.patch import Patch

Verdict = Literal["explained", "no-missing-effect", "outside-library"]

UNSEEN = 0.02
"""Time between two samples of a trace beyond which nothing is known of what lies between [s]."""


@dataclass(frozen=True)
class KnownEffect:
    """An effect that the rig was declared with, as it was fitted anew.

    Attributes:
      name: its name in the vocabulary.
      parameters, standard_errors: by parameter name, SI units.
      units: unit of each parameter.
    """

    name: str
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    units: Mapping[str, str]


@dataclass(frozen=True)
class AdoptedEffect(KnownEffect):
    """An effect that the model lacked.

    Attributes:
      probability: that it is this one, among the candidates tried and chance [1].
    """

    probability: float


@dataclass(frozen=True)
class Calibrated:
    """A declared parameter, moved within its uncertainty; one of a known effect, fitted anew."""

    declared: float
    fitted: float
    standard_error: float
    unit: str


@dataclass(frozen=True)
class ChannelError:
    """Root-mean-square of measured minus simulated over one recording, SI units.

    Attributes:
      before: of the model as declared.
      calibrated: with declared parameters refitted within their uncertainty.
      after: with the adopted effects.
      noise: standard deviation of the sensor.
      unit: SI unit of the channel.
      reach: root-mean-square change of the prediction where the break-away torque is off by 0.1 %: a recording in
        which a stick or slip more decides the rest cannot be predicted any better than this.
    """

    before: float
    calibrated: float
    after: float
    noise: float
    unit: str
    reach: float = math.nan


@dataclass(frozen=True)
class Prediction:
    """One recording beside what the three models make of it (channels at the instants of `measured`).

    `left_out` says what of it the errors do not count.
    """

    role: Literal["fit", "holdout"]
    measured: Recording
    before: Recording
    calibrated: Recording
    after: Recording
    errors: Mapping[str, ChannelError]
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class Trace:
    """What a model leaves unexplained, local in time: the picture of the cause.

    It is the calibrated model's, or that of the model that stands at the end where something is outside the library.

    Attributes:
      channel: whose: `hub_torque`, the balance of the hub, or the name of a sensor's channel.
      time: (n) [s], over all fit recordings one after the other.
      values: (n) in the unit of the channel, SI.
      variables: name -> (n) what it may depend on, SI: `hub_angle`, `hub_rate`, `time`, `torque_command`, ...
      explained_by: the variable that explains most of it, or None.
      fitted: (n) what the adopted effects say it should be, or None.
      recording: (n) index of the fit recording that each sample belongs to.
      since_start: (n) [s] since the first sample of that recording.
    """

    channel: str
    time: np.ndarray
    values: np.ndarray
    variables: Mapping[str, np.ndarray]
    recording: np.ndarray
    since_start: np.ndarray
    explained_by: str | None = None
    fitted: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Patched:
    """A correction without a cause, and what it gains where it was not fitted.

    Attributes:
      patch: the lookup.
      unit: of what it adds.
      errors: held-out file -> channel -> root-mean-square error without and with it, SI.
    """

    patch: Patch
    unit: str
    errors: Mapping[str, Mapping[str, tuple[float, float]]]

    def error(self, file: str, channel: str) -> float:
        """Root-mean-square error of a channel of a held-out file with the lookup, SI; NaN of any other file."""
        return self.errors.get(file, {}).get(channel, (math.nan, math.nan))[1]

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain values."""
        return {
            "channel": self.patch.channel,
            "variable": self.patch.variable,
            "unit": self.unit,
            "x": self.patch.x.tolist(),
            "y": self.patch.y.tolist(),
            "samples": self.patch.count.tolist(),
            "errors": {
                file: {c: {"without": pair[0], "with": pair[1]} for c, pair in channels.items()}
                for file, channels in self.errors.items()
            },
        }


@dataclass(frozen=True)
class RoundJudgement:
    """What a rule said of a candidate in a round of the search.

    Attributes:
      round: number of the round, from 1; None of a later look at adopted effects.
      judgement: statistic, limit, and whether it passed.
    """

    round: int | None
    judgement: Judgement

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain values."""
        return {"round": self.round, **asdict(self.judgement)}


@dataclass(frozen=True)
class Diagnosis:
    """The answer of the loop on a campaign; `to_json` gives its interface.

    Attributes:
      campaign: its name.
      verdict: "explained", "no-missing-effect" or "outside-library".
      summary: the story in a few plain sentences.
      effects: adopted effects, the most important first.
      known: effects that the rig was declared with.
      ranking: (name, score) of all candidates, best first; the score is the gain in log likelihood per candidate.
      indistinguishable: sets of effects that these recordings cannot tell apart.
      next_experiment: what to record to separate or confirm.
      depends_on: variables on which what is left unexplained depends, strongest first.
      calibrated: declared parameters that were refitted, those of known effects as "effect.parameter".
      predictions: by file name; held-out ones were simulated once, at the end.
      traces: what the calibrated model left unexplained; outside the library, what is left at the end.
      notes: assumptions and data defects that the reader should know.
      declared, fitted: the rig before and after calibration.
      wall_s: how long it took [s].
      threshold: score that the first round asked for: the larger of `by_chance` and `least_score`.
      false_alarm_rate: how often something may be found where nothing is missing, as asked for [1].
      by_chance: score that chance alone exceeds at this rate, in the first round.
      least_score: that is asked for whatever chance gives, because of the model's own error.
      not_fitted: candidates that were not fitted, because their slopes promised less: their score is but a bound.
      judgements: candidate that was fitted -> what each rule said of it, round by round.
      explanation: channel -> what each rule said of what is left of it at the end.
      patched: what is outside the library as a lookup, where it is a function of one variable.
      no_patch: where it is none, why not, in one sentence.
      correlations: of the errors of fitted parameters, declared ones and those of effects.
    """

    campaign: str
    verdict: Verdict
    summary: str
    effects: tuple[AdoptedEffect, ...]
    ranking: tuple[tuple[str, float], ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    next_experiment: str | None
    depends_on: tuple[str, ...]
    calibrated: Mapping[str, Calibrated]
    predictions: Mapping[str, Prediction]
    traces: tuple[Trace, ...]
    notes: tuple[str, ...]
    declared: Rig
    fitted: Rig
    wall_s: float = 0.0
    threshold: float | None = None
    false_alarm_rate: float | None = None
    by_chance: float | None = None
    least_score: float | None = None
    not_fitted: tuple[str, ...] = ()
    judgements: Mapping[str, tuple[RoundJudgement, ...]] = field(default_factory=dict)
    explanation: Mapping[str, tuple[Judgement, ...]] = field(default_factory=dict)
    patched: Patched | None = None
    no_patch: str | None = None
    known: tuple[KnownEffect, ...] = ()
    correlations: Correlations = field(default_factory=Correlations)

    def turned_down(self, name: str) -> RoundJudgement | None:
        """The first rule that a candidate failed in the last round in which it was fitted; None of an adopted one."""
        if name in {effect.name for effect in self.effects}:
            return None
        said = self.judgements.get(name, ())
        last = max((j.round or math.inf for j in said), default=None)
        failed = [j for j in said if (j.round or math.inf) == last and not j.judgement.passed]
        # That another one was better says least.
        return next((j for j in failed if j.judgement.rule != "best-of-round"), failed[0] if failed else None)

    def to_json(self) -> dict[str, Any]:
        """Returns the answer as a dictionary of plain values."""
        return {
            "campaign": self.campaign,
            "verdict": self.verdict,
            "summary": self.summary,
            "effects": [
                {"name": e.name, "probability": e.probability, **_values_json(e)} for e in self.effects
            ],
            "known_effects": [{"name": e.name, **_values_json(e)} for e in self.known],
            "ranking": [{"name": name, "score": score} for name, score in self.ranking],
            "not_fitted": list(self.not_fitted),
            "judgements": {n: [j.to_json() for j in said] for n, said in self.judgements.items()},
            "explanation": {c: [asdict(j) for j in said] for c, said in self.explanation.items()},
            "indistinguishable": [list(names) for names in self.indistinguishable],
            "next_experiment": self.next_experiment,
            "depends_on": list(self.depends_on),
            "calibrated": {
                name: {"declared": c.declared, "fitted": c.fitted, "standard_error": c.standard_error}
                for name, c in self.calibrated.items()
            },
            "errors": {file: _errors_json(file, p, self.patched) for file, p in self.predictions.items()},
            "threshold": self.threshold,
            "false_alarm_rate": self.false_alarm_rate,
            "by_chance": self.by_chance,
            "least_score": self.least_score,
            "patch": self.patched.to_json() if self.patched is not None else None,
            "no_patch": self.no_patch,
            "notes": list(self.notes),
            "wall_s": self.wall_s,
        }


def _values_json(effect: KnownEffect) -> dict[str, Any]:
    return {"parameters": dict(effect.parameters), "standard_errors": dict(effect.standard_errors)}


def _errors_json(file: str, prediction: Prediction, patched: Patched | None) -> dict[str, Any]:
    rows: dict[str, Any] = {"role": prediction.role}
    for channel, error in prediction.errors.items():
        rows[channel] = {
            "before": error.before,
            "calibrated": error.calibrated,
            "after": error.after,
            "noise": error.noise,
            "reach": error.reach if math.isfinite(error.reach) else None,
            "unit": CHANNEL_UNITS[channel],
        }
        with_patch = patched.error(file, channel) if patched else math.nan
        if math.isfinite(with_patch):
            rows[channel]["patched"] = with_patch
    return rows
