"""Verdict, sentences and numbers of the answer, from the end of the search and the last fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.correlations import Correlations, from_covariance
from twin.diagnosis import (
    budget_text,
    contradiction,
    dependence,
    experiments,
    fit_patch,
    notes,
    permutation,
    remainder,
    rules,
    traces,
)
from twin.diagnosis.answer import (
    ActsLike,
    AdoptedEffect,
    Calibrated,
    Contradiction,
    Diagnosis,
    KnownEffect,
    Patched,
    Prediction,
    RoundJudgement,
    Verdict,
)
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.experiments import Plan
from twin.diagnosis.state import Round, SearchState, UnnamedFunction
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.static_friction import FinalModels
from twin.recording import HUB_TORQUE, ON_HUB

_BENDS = "Record slews of several sizes: the faster they are, the further the link bends."
_SPEEDS = "Record slews of one angle at several speeds."
_EXPERIMENTS = {
    "torque_command": "Record ramps of torque to several levels, both ways.",
    "hub_angle": "Record the same small motion about several angles of the hub.",
    "hub_rate": _SPEEDS,
    "tip_rate": _SPEEDS,
    "strain_base": _BENDS,
    "strain_mid": _BENDS,
    "time": "Repeat one run several times, at once and after a rest: see what continues and what starts again.",
    dependence.TRAVEL: "Oscillate the hub slowly, with an amplitude that grows from small values: hysteresis "
    "shows in the torque after each reversal.",
}
"""Variable on which unexplained residuals depend -> experiment that gives more information."""
_REPEAT = "Repeat one run several times: residuals that recur at the same instants are no random errors."
_PROBABILITY_OUTSIDE = 0.5
"""Factor of the probability of an adopted effect when residuals stay unexplained: it may only imitate a part of the
unknown fault."""


def conclude(
    campaign: Campaign,
    state: SearchState,
    residuals: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    plans: Sequence[Plan],
    patched: Patched | None,
    on_link: Sequence[UnnamedFunction] = (),
) -> Diagnosis:
    """The answer.

    Args:
      campaign: the recordings.
      state: the end of the search.
      residuals: channel -> residuals of the final model.
      polished: the three models that predict recordings.
      predictions: file -> recording and simulations.
      plans: experiments that separate the two closest candidates, best first.
      patched: the lookup for unexplained residuals, or None.
      on_link: functions that were tried on the link, the largest evidence first.
    """
    unexplained = remainder.unexplained_channels(state)
    in_one = {channel for _, channel, _ in remainder.in_one_recording(state)}
    contradicted = (
        () if unexplained else contradiction.contradictions(predictions, bool(state.adopted), in_one)
    )
    answer: Verdict = "outside-library" if contradicted else verdict_of(state)
    effects = _effects(state, polished, answer)
    first = state.rounds[0] if state.rounds else Round(())
    alike = rules.alternatives([r.ranked for r in state.adopting])
    depends = explanatory_variables(state, residuals, on_link)
    functions = remainder.likeliest_functions(state, on_link)
    acts_like = _acts_like(functions, depends)
    return Diagnosis(
        campaign=campaign.name,
        verdict=answer,
        summary=_summary(answer, effects, unexplained, depends, predictions, contradicted, acts_like),
        effects=effects,
        known=tuple(KnownEffect(**_effect_values(polished.augmented, name)) for name in state.known),
        ranking=tuple((c.name, c.score) for c in first.ranked),
        not_fitted=tuple(c.name for c in first.ranked if not c.is_fitted),
        judgements=judgements_of(state),
        explanation=remainder.judge_channels(state),
        indistinguishable=tuple(alike),
        next_experiment=_next_experiment(answer, alike, depends, plans, contradicted),
        depends_on=depends if answer == "outside-library" else (),
        acts_like=acts_like,
        calibrated=_calibrated(campaign, polished.augmented),
        predictions=dict(predictions),
        traces=traces.final_traces(residuals, unexplained, depends)
        if unexplained
        else traces.explained_traces(state, residuals),
        notes=notes.all_notes(campaign, state, residuals, polished, predictions, depends, functions),
        caveats=notes.verdict_caveats(campaign, polished.augmented, bool(state.adopted)),
        contradicted=contradicted,
        declared=campaign.rig,
        fitted=polished.augmented.model.declared,
        threshold=first.threshold if first.ranked else None,
        by_chance=first.by_chance if first.ranked else None,
        least_score=rules.MODEL_ERROR_SCORE,
        patched=patched if patched is not None and not patched.is_worse else None,
        no_patch=_why_no_patch(state, residuals, unexplained, depends, patched),
        correlations=_correlations(polished.augmented),
    )


def _why_no_patch(
    state: SearchState,
    residuals: Mapping[str, Unexplained],
    unexplained: Sequence[str],
    depends: Sequence[str],
    patched: Patched | None,
) -> str | None:
    """Why no lookup is handed out, in a sentence; None if there is one, or nothing to look up."""
    if patched is not None:
        return fit_patch.WORSE if patched.is_worse else None
    if not unexplained:
        return None
    worst = {c: residuals[c] for c in unexplained if c in residuals}
    return fit_patch.why_no_patch(worst, depends, remainder.significant_function(state))


def verdict_of(state: SearchState) -> Verdict:
    """The verdict of a search."""
    if remainder.unexplained_channels(state):
        return "outside-library"
    return "explained" if state.adopted else "no-missing-effect"


def _effects(state: SearchState, polished: FinalModels, answer: Verdict) -> tuple[AdoptedEffect, ...]:
    probabilities = effect_probabilities(state, answer)
    return tuple(
        AdoptedEffect(**_effect_values(polished.augmented, name), probability=probabilities[name])
        for name in state.names
    )


def _effect_values(fit: Fit, name: str) -> dict[str, Any]:
    """Name, values, standard errors and units of an effect of a fit, as arguments of `KnownEffect`."""
    values = dict(fit.model.effects[name])
    units = REGISTRY[name].units(values)
    return {
        "name": name,
        "parameters": values,
        "standard_errors": standard_errors(fit, name),
        "units": {n: units[n] for n in values},
    }


def effect_probabilities(state: SearchState, answer: Verdict) -> dict[str, float]:
    """Adopted effect -> its posterior probability, see `rules.probabilities`; `answer`: the verdict."""
    factor = _PROBABILITY_OUTSIDE if answer == "outside-library" else 1.0
    return {name: factor * _probability(r, name) for name, r in zip(state.names, state.adopting, strict=True)}


def _probability(adopting: Round, name: str) -> float:
    """Posterior probability of the effect that a round adopted."""
    if adopting.p_value is not None:
        return permutation.posterior_bound(adopting.p_value)
    return rules.probabilities(adopting.ranked, adopting.draws).get(name, 0.0)


def judgements_of(state: SearchState) -> dict[str, tuple[RoundJudgement, ...]]:
    """Candidate -> its judgement by each rule, round by round, and by the rule that withdrew it, if any."""
    judged: dict[str, list[RoundJudgement]] = {}
    for number, r in enumerate(state.rounds, start=1):
        for name, judgements in r.judgements.items():
            judged.setdefault(name, []).extend(RoundJudgement(number, j) for j in judgements)
    for name, judgement in state.withdrawn:
        judged.setdefault(name, []).append(RoundJudgement(None, judgement))
    return {name: tuple(judgements) for name, judgements in judged.items()}


def standard_errors(fit: Fit, name: str) -> dict[str, float]:
    """Parameter of an effect -> its standard error; where the reciprocal was fitted, by error propagation."""
    pairs = [(u, float(e)) for u, e in zip(fit.unknowns, fit.errors, strict=True) if u.effect == name]
    values = fit.model.effects[name]
    return {u.name: e * values[u.name] ** 2 if u.inverse else e for u, e in pairs}


def _calibrated(campaign: Campaign, fit: Fit) -> dict[str, Calibrated]:
    calibrated = {}
    for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True):
        if u.kind == "rig":
            unit = campaign.rig.parameters[u.name].unit
            calibrated[u.name] = Calibrated(campaign.rig[u.name], float(value), float(error), unit)
        elif u.is_channel_error:
            unit = "s" if u.kind == "delay" else "1"
            calibrated[f"{u.name}.{u.kind}"] = Calibrated(u.start, float(value), float(error), unit, u.scale)
    for name, declared in campaign.effects.items():
        fitted, errors = fit.model.effects[name], standard_errors(fit, name)
        units = REGISTRY[name].units(fitted)
        for parameter, error in errors.items():
            calibrated[f"{name}.{parameter}"] = Calibrated(
                declared[parameter], fitted[parameter], error, units[parameter]
            )
    return calibrated


def _correlations(fit: Fit) -> Correlations:
    """Correlations of parameters of rig and effects; a parameter whose reciprocal was fitted changes its sign."""
    kept = [i for i, u in enumerate(fit.unknowns) if u.is_parameter]
    unknowns = [fit.unknowns[i] for i in kept]
    sign = np.array([-1.0 if u.inverse else 1.0 for u in unknowns])
    return from_covariance(
        [u.full_name for u in unknowns], fit.covariance[np.ix_(kept, kept)] * np.outer(sign, sign)
    )


def _acts_like(functions: Sequence[UnnamedFunction], depends: Sequence[str]) -> ActsLike | None:
    """What is missing, as the likeliest function; None if another is as likely, or its variable does not come first."""
    if len(functions) != 1 or functions[0].law.variable not in depends[:1]:
        return None
    [best] = functions
    return ActsLike(best.law.place, best.law.variables, best.evidence)


def explanatory_variables(
    state: SearchState, residuals: Mapping[str, Unexplained], on_link: Sequence[UnnamedFunction] = ()
) -> tuple[str, ...]:
    """Variables on which unexplained residuals depend, the strongest first; empty if all is explained."""
    large = [residuals[c] for c in remainder.large_residuals(state) if c in residuals]
    depends = dependence.strongest_variables([r for r in large if len(r.values) > traces.FEWEST])
    functions = remainder.likeliest_functions(state, on_link)
    if not functions:
        return depends
    if functions[0] in on_link:
        # Where the function acts is part of what is compared, so that its variable needs no other next to it.
        return tuple(dict.fromkeys(v for f in functions for v in f.law.variables))
    # Where a smooth function of the strongest variable was tested, its evidence decides better than the variance.
    tested = not depends or depends[0] in {f.law.variable for f in (*state.unnamed, *on_link)}
    of_function = functions[0].law.variables
    first, then = (of_function, depends) if tested else (depends, of_function)
    return tuple(dict.fromkeys((*first, *then)))


def _summary(
    answer: Verdict,
    effects: Sequence[AdoptedEffect],
    unexplained: Sequence[str],
    depends: Sequence[str],
    predictions: Mapping[str, Prediction],
    contradicted: Sequence[Contradiction] = (),
    acts_like: ActsLike | None = None,
) -> str:
    budget, noise = _budget(predictions, depends if unexplained else ()), _held_out(predictions)
    if answer == "explained":
        return _joined(budget, noise)
    if answer == "no-missing-effect":
        explains = "The declared model, calibrated within its uncertainty, explains the recordings."
        return _joined(budget, explains, noise)
    if contradicted:
        worst = contradicted[0]
        explains = "The fit recordings are explained."
        return _joined(budget, explains, contradiction.in_words(worst, labels.with_the(worst.channel)), noise)
    where = " and ".join(_place(channel) for channel in unexplained)
    is_not = "are not" if len(unexplained) > 1 else "is not"
    names = labels.join_with_and([labels.words(e.name) for e in effects]) if effects else ""
    something = f"Beside {names}, something" if effects else "Something"
    missing = f"{something} outside the library is missing: {where} {is_not} explained."
    known = f"It {labels.dependence(depends)}." if depends else ""
    if acts_like is not None:
        known = f"It {labels.dependence(acts_like.variables, acts_like.place)}."
    return _joined(budget, missing, known, noise)


def _joined(*sentences: str) -> str:
    return " ".join(s for s in sentences if s)


def _budget(predictions: Mapping[str, Prediction], depends: Sequence[str]) -> str:
    """The error budget in words, of the recordings that evaluate the answer."""
    held_out = any(p.role == "holdout" for p in predictions.values())
    return budget_text.sentences([p.budget for p in predictions.values() if p.budget], depends, held_out)


def _held_out(predictions: Mapping[str, Prediction]) -> str:
    errors = [
        e for p in predictions.values() if p.role == "holdout" for e in p.errors.values() if e.noise > 0
    ]
    if not errors:
        return "No recording was held out."
    before, after = (median(getattr(e, which) / e.noise for e in errors) for which in ("before", "after"))
    fell = f"falls from {labels.ratio(before)} to" if before > after else "is"
    return f"Over all channels and whole runs the median error {fell} {labels.ratio(after)} noise levels."


def _place(channel: str) -> str:
    if channel == HUB_TORQUE:
        return "the balance of the hub (drive, friction, hub)"
    where = "hub or sensor" if channel in ON_HUB else "link or sensor"
    return f"{labels.channel(channel).label} ({where})"


def _next_experiment(
    answer: Verdict,
    alike: Sequence[Sequence[str]],
    depends: Sequence[str],
    plans: Sequence[Plan],
    contradicted: Sequence[Contradiction],
) -> str | None:
    if contradicted:
        return (
            f"Fit {contradicted[0].recording} too, and hold out another recording like it: it shows what the fitted "
            "ones do not."
        )
    if alike and plans:
        return experiments.recommendation(plans, alike[0][:2])
    if answer == "outside-library":
        return _EXPERIMENTS[depends[0]] if depends else _REPEAT
    return None
