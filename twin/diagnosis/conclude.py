"""From the search and the last fit to what is said: verdict, sentences, numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from twin import labels
from twin.campaigns.campaign import Campaign
from twin.correlations import Correlations, from_covariance
from twin.diagnosis import dependence, experiments, fit_patch, notes, remainder, rules, traces
from twin.diagnosis.answer import (
    AdoptedEffect,
    Calibrated,
    Diagnosis,
    KnownEffect,
    Patched,
    Prediction,
    RoundJudgement,
    Verdict,
)
from twin.diagnosis.dependence import Unexplained
from twin.diagnosis.experiments import Plan
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.static_friction import FinalModels
from twin.recording import HUB

_BENDS = "Record slews of several sizes: the faster they are, the further the link bends."
_SPEEDS = "Record slews of one angle at several speeds."
_TELLING = {
    "torque_command": "Record ramps of torque to several levels, both ways.",
    "hub_angle": "Record the same small motion about several angles of the hub.",
    "hub_rate": _SPEEDS,
    "tip_rate": _SPEEDS,
    "strain_base": _BENDS,
    "strain_mid": _BENDS,
    "time": "Repeat one run several times, at once and after a rest: see what goes on and what begins anew.",
    dependence.TRAVEL: "Let the hub swing slowly to and fro, by little at first and by more each time: what "
    "holds it back before it has turned far shows there.",
}
"""Variable on which something outside the library depends -> experiment that tells more."""
_AGAIN = "Repeat one run several times: what comes again at the same instants is the rig's, what does not is chance."
_BESIDE_UNKNOWN = 0.5
"""That an effect is missing indeed, and does not stand for a part of what has no name, where that is missing, too."""


def conclude(
    campaign: Campaign,
    found: SearchState,
    behind: Mapping[str, Unexplained],
    polished: FinalModels,
    predictions: Mapping[str, Prediction],
    plans: Sequence[Plan],
    patched: Patched | None,
) -> Diagnosis:
    """Puts the answer together; `behind` is what the model leaves unexplained that stands at the end."""
    left = remainder.unexplained_channels(found)
    answer = verdict_of(found)
    effects = _effects(found, polished)
    first = found.rounds[0] if found.rounds else Round(())
    alike = rules.alternatives([r.ranked for r in found.adopting])
    depends = dependence_of(found, behind)
    return Diagnosis(
        campaign=campaign.name,
        verdict=answer,
        summary=_summary(answer, effects, left, depends, predictions),
        effects=effects,
        known=tuple(KnownEffect(**_told(polished.augmented, name)) for name in found.known),
        ranking=tuple((c.name, c.score) for c in first.ranked),
        not_fitted=tuple(c.name for c in first.ranked if not c.is_fitted),
        judgements=_judgements(found),
        explanation=remainder.judge_channels(found),
        indistinguishable=tuple(alike),
        next_experiment=_next(answer, alike, depends, plans),
        depends_on=depends if answer == "outside-library" else (),
        calibrated=_calibrated(campaign, polished.augmented),
        predictions=dict(predictions),
        traces=traces.remaining(behind, left, depends) if left else traces.traces_of(found, behind),
        notes=notes.all_notes(campaign, found, behind, polished, predictions, depends),
        declared=campaign.rig,
        fitted=polished.augmented.model.declared,
        threshold=first.threshold if first.ranked else None,
        by_chance=first.by_chance if first.ranked else None,
        least_score=rules.MODEL_ERROR_SCORE,
        patched=patched,
        no_patch=fit_patch.why_no_patch(
            {c: behind[c] for c in left}, depends, remainder.significant_function(found)
        )
        if left and patched is None
        else None,
        correlations=_correlations(polished.augmented),
    )


def verdict_of(found: SearchState) -> Verdict:
    """The verdict of a search."""
    if remainder.unexplained_channels(found):
        return "outside-library"
    return "explained" if found.adopted else "no-missing-effect"


def _effects(found: SearchState, polished: FinalModels) -> tuple[AdoptedEffect, ...]:
    shares = effect_probabilities(found)
    return tuple(
        AdoptedEffect(**_told(polished.augmented, name), probability=shares[name]) for name in found.names
    )


def _told(fit: Fit, name: str) -> dict[str, Any]:
    """Name, values, standard errors and units of an effect of a fit."""
    values = dict(fit.model.effects[name])
    units = REGISTRY[name].units(values)
    return {
        "name": name,
        "parameters": values,
        "standard_errors": errors_of(fit, name),
        "units": {n: units[n] for n in values},
    }


def effect_probabilities(found: SearchState) -> dict[str, float]:
    """Probability of each adopted effect that it is missing indeed."""
    beside = _BESIDE_UNKNOWN if verdict_of(found) == "outside-library" else 1.0
    return {
        name: beside * rules.probabilities(r.ranked, r.draws).get(name, 0.0)
        for name, r in zip(found.names, found.adopting, strict=True)
    }


def _judgements(found: SearchState) -> dict[str, tuple[RoundJudgement, ...]]:
    """Candidate -> what the rules said of it, round by round, and why it was withdrawn, if it was."""
    said: dict[str, list[RoundJudgement]] = {}
    for number, r in enumerate(found.rounds, start=1):
        for name, judgements in r.judgements.items():
            said.setdefault(name, []).extend(RoundJudgement(number, j) for j in judgements)
    for name, judgement in found.withdrawn:
        said.setdefault(name, []).append(RoundJudgement(None, judgement))
    return {name: tuple(judgements) for name, judgements in said.items()}


def errors_of(fit: Fit, name: str) -> dict[str, float]:
    """Standard errors of an effect's parameters; where one over a value was fitted, those of the value."""
    pairs = [(u, float(e)) for u, e in zip(fit.unknowns, fit.errors, strict=True) if u.effect == name]
    values = fit.model.effects[name]
    return {u.name: e * values[u.name] ** 2 if u.inverse else e for u, e in pairs}


def _calibrated(campaign: Campaign, fit: Fit) -> dict[str, Calibrated]:
    found = {}
    for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True):
        if u.kind == "rig":
            unit = campaign.rig.parameters[u.name].unit
            found[u.name] = Calibrated(campaign.rig[u.name], float(value), float(error), unit)
    for name, declared in campaign.effects.items():
        fitted, errors = fit.model.effects[name], errors_of(fit, name)
        units = REGISTRY[name].units(fitted)
        for parameter, error in errors.items():
            found[f"{name}.{parameter}"] = Calibrated(
                declared[parameter], fitted[parameter], error, units[parameter]
            )
    return found


def _correlations(fit: Fit) -> Correlations:
    """Of the rig's parameters and the effects' own; a number that stands for its inverse turns its sign."""
    kept = [i for i, u in enumerate(fit.unknowns) if u.is_parameter]
    unknowns = [fit.unknowns[i] for i in kept]
    sign = np.array([-1.0 if u.inverse else 1.0 for u in unknowns])
    return from_covariance(
        [u.full_name for u in unknowns], fit.covariance[np.ix_(kept, kept)] * np.outer(sign, sign)
    )


def dependence_of(found: SearchState, behind: Mapping[str, Unexplained]) -> tuple[str, ...]:
    """Variables on which what is left unexplained depends, the first most; none where nothing is."""
    told = [
        behind[channel] for channel in remainder.large_residuals(found) if len(behind[channel].values) > 50
    ]
    depends = dependence.strongest_variables(told)
    smooth = remainder.significant_function(found)
    if smooth is None:
        return depends
    # Where a function of the same variables was asked for, its evidence tells best which one it is.
    known = not depends or depends[0] in {n.law.variable for n in found.unnamed}
    first, then = (smooth.law.variables, depends) if known else (depends, smooth.law.variables)
    return tuple(dict.fromkeys((*first, *then)))


def _summary(
    answer: Verdict,
    effects: Sequence[AdoptedEffect],
    left: Sequence[str],
    depends: Sequence[str],
    predictions: Mapping[str, Prediction],
) -> str:
    *first, last = [e.name for e in effects] or [""]
    names = f"{', '.join(first)} and {last}" if first else last
    held = _held_out(predictions)
    if answer == "no-missing-effect":
        return f"The declared model, calibrated within its uncertainty, explains the recordings. {held}"
    if answer == "explained":
        return held
    where = " and ".join(_place(channel) for channel in left)
    is_not = "are not" if len(left) > 1 else "is not"
    known = f" It depends on {', '.join(labels.named(name) for name in depends[:3])}." if depends else ""
    part = "explain a part" if len(effects) > 1 else "explains a part"
    partly = f" {names.capitalize()} {part} of it." if effects else ""
    return f"Something outside the library is missing: {where} {is_not} explained.{known}{partly} {held}"


def _held_out(predictions: Mapping[str, Prediction]) -> str:
    errors = [
        e for p in predictions.values() if p.role == "holdout" for e in p.errors.values() if e.noise > 0
    ]
    if not errors:
        return "No recording was held out."
    before, after = (sorted(getattr(e, which) / e.noise for e in errors) for which in ("before", "after"))
    middle = len(errors) // 2
    return (
        f"On held-out recordings the median error falls from {before[middle]:.3g} to {after[middle]:.3g} noise levels."
        if before[middle] > after[middle]
        else f"On held-out recordings the median error is {after[middle]:.3g} noise levels."
    )


def _place(channel: str) -> str:
    if channel == HUB:
        return "the balance of the hub (drive, friction, hub)"
    return f"{labels.channel(channel).label} (link or sensor)"


def _next(
    answer: Verdict, alike: Sequence[Sequence[str]], depends: Sequence[str], plans: Sequence[Plan]
) -> str | None:
    if alike and plans:
        return experiments.recommendation(plans, alike[0][:2])
    if answer == "outside-library":
        return _TELLING[depends[0]] if depends else _AGAIN
    return None
