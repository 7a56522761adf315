"""The answer of a diagnosis as plain values, for the report, the JSON file and the tests."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from twin.correlations import Correlations
from twin.diagnosis.error_budget import ChannelBudget, ModelError
from twin.diagnosis.judgement import Judgement
from twin.files.provenance import Provenance
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS, Recording
from twin.rigs.patch import Patch

Verdict = Literal["explained", "no-missing-effect", "outside-library"]

MODELS = ("before", "calibrated", "after")
"""The declared, the calibrated and the final model, in the order of a diagnosis."""

LONGEST_GAP = 0.02
"""Longest time between two samples of a trace that a plot connects [s]."""


@dataclass(frozen=True)
class KnownEffect:
    """An effect that the rig was declared with, its parameters fitted to the recordings.

    Attributes:
      name: key in the registry of effects.
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
      probability: posterior probability of this effect among all candidates and no effect.
    """

    probability: float


@dataclass(frozen=True)
class Calibrated:
    """A declared parameter, or a channel's gain or delay, fitted within its uncertainty, or that of a known effect.

    Attributes:
      declared, fitted, standard_error: SI.
      unit: of these.
      uncertainty: declared standard deviation of a channel's gain or delay, in `unit`; None of any other.
    """

    declared: float
    fitted: float
    standard_error: float
    unit: str
    uncertainty: float | None = None


@dataclass(frozen=True)
class ChannelError:
    """Root-mean-square prediction error of one channel of a recording, SI units.

    Attributes:
      before: of the declared model.
      calibrated: of the calibrated model.
      after: of the calibrated model with the adopted effects.
      noise: standard deviation of the sensor noise.
      unit: SI unit of the channel.
      reach: sensitivity, the root-mean-square change of the prediction by a change of the break-away torque of 0.1 %.
        Where one stick or slip decides the rest of a recording, no model predicts it more accurately than this.
      by_gaps: the same by other commands where rows are missing, and the commands with them; 0 without missing rows.
    """

    before: float
    calibrated: float
    after: float
    noise: float
    unit: str
    reach: float = math.nan
    by_gaps: float = 0.0

    @property
    def unknown(self) -> float:
        """The larger one of `reach` and `by_gaps`."""
        return float(np.fmax(self.reach, self.by_gaps))


@dataclass(frozen=True)
class Prediction:
    """One recording and its simulation by three models, from its first sample and its command alone.

    Attributes:
      role: whether it was used in the fit or held out.
      measured: the recording.
      before, calibrated, after: simulations at its instants, see `ChannelError`.
      errors: channel -> prediction errors.
      left_out: parts of the recording that the errors leave out, as sentences.
      budget: channel -> its errors along the steps of the diagnosis; empty for recordings that do not evaluate it.
      windows: channel -> error of the final model, with that in windows; empty where the verdict does not ask for it.
      torque: torque on the hub that a model lacks in a held-out recording, estimated as in `Diagnosis.traces`; None
        where that is not possible, and for recordings that were fitted.
      zeros: model -> channel whose sensor has an unknown zero -> that zero, as the errors take it out [SI].
    """

    role: Literal["fit", "holdout"]
    measured: Recording
    before: Recording
    calibrated: Recording
    after: Recording
    errors: Mapping[str, ChannelError]
    left_out: tuple[str, ...] = ()
    budget: Mapping[str, ChannelBudget] = field(default_factory=dict)
    windows: Mapping[str, ModelError] = field(default_factory=dict)
    torque: Trace | None = None
    zeros: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def reading(self, model: str, channel: str) -> np.ndarray:
        """Readings (m) of a channel [SI].

        Args:
          model: "before", "calibrated" or "after", for simulated readings with the zero of the sensor; or "measured".
          channel: of these readings.
        """
        return getattr(self, model)[channel] + self.zeros.get(model, {}).get(channel, 0.0)

    def residual(self, model: str, channel: str) -> np.ndarray:
        """Measured minus simulated readings (m) of a channel; arguments as `reading`."""
        return self.measured[channel] - self.reading(model, channel)

    @property
    def unknown_zeros(self) -> tuple[str, ...]:
        """Channels whose sensor has an unknown zero."""
        return tuple(self.zeros.get("after", {}))


@dataclass(frozen=True)
class Contradiction:
    """A held-out recording that contradicts the final model in one channel.

    Attributes:
      recording, channel: where.
      size: median error of its windows [noise levels].
      limit: largest that noise, and the errors of the fit recordings, allow [noise levels].
      reference: "fit" if the windows of the fit recordings set the limit, "calibrated" if those of the calibrated model
        without effects, which predicts the recording better, "one" if noise does, since one fit recording is
        unexplained, too.
    """

    recording: str
    channel: str
    size: float
    limit: float
    reference: str


@dataclass(frozen=True)
class Trace:
    """Residuals of one channel over all fit recordings, for a plot.

    Attributes:
      channel: `hub_torque`, the torque balance of the hub, or the channel of a sensor.
      time: (n) [s], the recordings concatenated.
      values: (n) residuals, SI.
      variables: name -> (n) on which they may depend, SI: `hub_angle`, `hub_rate`, `time`, `torque_command`, ...
      recording: (n) index of the fit recording.
      since_start: (n) [s] since the first sample of that recording.
      explained_by: the variable that explains most of their variance, or None.
      fitted: (n) part of them that the adopted effects explain, or None.
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
    """An empirical correction of the model as a lookup, and its effect on held-out recordings.

    Attributes:
      patch: the lookup.
      unit: of the correction.
      errors: held-out file -> channel -> root-mean-square error without and with the lookup, SI.
    """

    patch: Patch
    unit: str
    errors: Mapping[str, Mapping[str, tuple[float, float]]]

    @property
    def is_worse(self) -> bool:
        """Whether held-out errors grow with the lookup, in their geometric mean, or are not finite."""
        ratios = [after / before for c in self.errors.values() for before, after in c.values() if before > 0]
        return bool(ratios) and not math.prod(ratios) <= 1

    def error(self, file: str, channel: str) -> float:
        """Root-mean-square error of a channel of a held-out file with the lookup, SI; NaN for any other file."""
        return self.errors.get(file, {}).get(channel, (math.nan, math.nan))[1]

    def to_json(self) -> dict[str, Any]:
        """The lookup as plain values."""
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
    """Judgement of a candidate by one rule in one round of the search.

    Attributes:
      round: number of the round, from 1; None for a rule of revision.
      judgement: statistic, limit, and whether it passed.
    """

    round: int | None
    judgement: Judgement

    def to_json(self) -> dict[str, Any]:
        """The judgement as plain values."""
        return {"round": self.round, **_judgement_json(self.judgement)}


@dataclass(frozen=True)
class ActsLike:
    """The function that describes what is unexplained, where no other does so as well.

    Attributes:
      place: where it acts, see `twin.diagnosis.state.FunctionOf`.
      variables: on which it depends.
      log_evidence: log Bayes factor of the function against none.
    """

    place: str
    variables: tuple[str, ...]
    log_evidence: float


@dataclass(frozen=True)
class Diagnosis:
    """The answer of a diagnosis; `to_json` is its interface.

    Attributes:
      campaign: name of the campaign.
      verdict: "explained", "no-missing-effect" or "outside-library".
      summary: the verdict in a few sentences.
      effects: adopted effects, in the order of adoption.
      ranking: (name, score) of all candidates of the first round, best first; the score is the penalised
        log-likelihood ratio.
      indistinguishable: sets of effects whose scores differ by too little for a decision.
      next_experiment: what to record to separate or confirm them.
      depends_on: variables on which unexplained residuals depend, strongest first.
      acts_like: the function that describes them where no other does so as well, or None.
      calibrated: declared parameters that were fitted, those of known effects as "effect.parameter", gains and delays
        of channels as "channel.gain" and "channel.delay".
      predictions: file -> recording and simulations; held-out recordings were simulated once, at the end.
      traces: residuals of the calibrated model; outside the library, those of the final model.
      notes: assumptions, and defects of the data.
      caveats: what has to be settled before the verdict is used, as short sentences.
      declared, fitted: the rig before and after calibration.
      wall_s: duration of the diagnosis [s].
      threshold: score that an effect of the first round had to exceed: the larger of `by_chance` and `least_score`.
      false_alarm_rate: as requested.
      by_chance: threshold of the permutation test at this rate, in the first round.
      least_score: threshold by the discretisation error of the model.
      not_fitted: candidates that were not fitted; their score is that of the score test.
      judgements: candidate -> its judgement by each rule, round by round.
      explanation: channel -> judgement of its residuals by each rule.
      patched: the unexplained residuals as a lookup over one variable, or None.
      no_patch: why there is no lookup, in a sentence, or None.
      contradicted: held-out recordings that withdraw the verdict of the fit recordings.
      known: effects that the rig was declared with.
      correlations: of the errors of fitted parameters of rig and effects.
      provenance: what it was computed with and from, or None if that was not recorded.
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
    contradicted: tuple[Contradiction, ...] = ()
    known: tuple[KnownEffect, ...] = ()
    correlations: Correlations = field(default_factory=Correlations)
    caveats: tuple[str, ...] = ()
    acts_like: ActsLike | None = None
    provenance: Provenance | None = None

    @property
    def never_fitted(self) -> tuple[str, ...]:
        """Candidates that were fitted in no round."""
        return tuple(name for name in self.not_fitted if not self._is_fitted(name))

    def _is_fitted(self, name: str) -> bool:
        return any(j.judgement.rule == _SCORE_RULES[0] for j in self.judgements.get(name, ()))

    def nearest_round(self, name: str) -> int | None:
        """The round in which a candidate came nearest to adoption, or was adopted; None if it was judged in none.

        It is the one with the largest score over the score that the round required, of those in which it was fitted.
        """
        rounds: dict[int, list[Judgement]] = {}
        for judged in self.judgements.get(name, ()):
            if judged.round is not None:
                rounds.setdefault(judged.round, []).append(judged.judgement)
        return max(rounds, key=lambda number: _nearness(rounds[number]), default=None)

    def score(self, name: str) -> float:
        """Score of a candidate in its nearest round; in the first one where it was not fitted; NaN without any."""
        nearest = self.nearest_round(name)
        values = [
            j.judgement.value
            for j in self.judgements.get(name, ())
            if j.round == nearest and j.judgement.rule == _SCORE_RULES[0]
        ]
        return values[0] if values else dict(self.ranking).get(name, math.nan)

    def failed_rule(self, name: str) -> RoundJudgement | None:
        """The rule that withdrew a candidate, or else excluded it in its nearest round; None for an adopted one.

        Where it failed several, it is the first one other than "best-of-round".
        """
        if name in {effect.name for effect in self.effects}:
            return None
        judged = self.judgements.get(name, ())
        withdrawn = any(j.round is None for j in judged)
        decisive = None if withdrawn else self.nearest_round(name)
        failed = [j for j in judged if j.round == decisive and not j.judgement.passed]
        return next((j for j in failed if j.judgement.rule != "best-of-round"), failed[0] if failed else None)

    def to_json(self) -> dict[str, Any]:
        """The answer as plain values."""
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
            "judgements": {n: [j.to_json() for j in judged] for n, judged in self.judgements.items()},
            "explanation": {
                c: [_judgement_json(j) for j in judged] for c, judged in self.explanation.items()
            },
            "indistinguishable": [list(names) for names in self.indistinguishable],
            "next_experiment": self.next_experiment,
            "depends_on": list(self.depends_on),
            "acts_like": asdict(self.acts_like) if self.acts_like is not None else None,
            "calibrated": {
                name: {"declared": c.declared, "fitted": c.fitted, "standard_error": c.standard_error}
                for name, c in self.calibrated.items()
            },
            "contradicted": [asdict(c) for c in self.contradicted],
            "error_budget": {
                file: {c: budget.to_json() for c, budget in p.budget.items()}
                for file, p in self.predictions.items()
                if p.budget
            },
            "errors": {file: _errors_json(file, p, self.patched) for file, p in self.predictions.items()},
            "threshold": self.threshold,
            "false_alarm_rate": self.false_alarm_rate,
            "by_chance": self.by_chance,
            "least_score": self.least_score,
            "patch": self.patched.to_json() if self.patched is not None else None,
            "no_patch": self.no_patch,
            "notes": list(self.notes),
            "caveats": list(self.caveats),
            "wall_s": self.wall_s,
            "provenance": self.provenance.to_json() if self.provenance is not None else None,
        }


_SCORE_RULES = ("exceeds-chance", "exceeds-model-error")
"""Rules on the score of a fitted candidate."""


def _nearness(judgements: Sequence[Judgement]) -> tuple[bool, bool, float]:
    """Whether a candidate was fitted in a round, passed its rules, and its score over that required; to be compared."""
    scores = [j for j in judgements if j.rule in _SCORE_RULES]
    required = max((j.limit for j in scores), default=0.0)
    share = scores[0].value / required if required > 0 else 0.0
    return bool(scores), all(j.passed for j in judgements), share


def _judgement_json(judgement: Judgement) -> dict[str, Any]:
    """The judgement as plain values; a statistic that does not exist for the trial, infinite, is None."""
    values = asdict(judgement)
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}


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
            "reach": error.unknown if math.isfinite(error.unknown) else None,
            "unit": CHANNEL_UNITS[channel],
        }
        with_patch = patched.error(file, channel) if patched else math.nan
        if math.isfinite(with_patch):
            rows[channel]["patched"] = with_patch
    return rows
