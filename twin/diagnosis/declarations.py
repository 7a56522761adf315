"""Declarations that the recordings contradict: an effect for one, where all else is explained."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from twin.diagnosis import candidates, contest, remainder, rules
from twin.diagnosis.candidates import Candidate
from twin.diagnosis.rules import CONTRADICTED, Declaration
from twin.diagnosis.state import Round, SearchState
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.slopes import prior_cost
from twin.parameters import relative_uncertainty


def with_contradicted_declaration(state: SearchState, rate: float) -> SearchState | None:
    """The state with an effect for a declaration which the recordings contradict; None without one.

    It replaces a declared parameter, stands for gain or delay of a channel beyond the declared uncertainty, or is one
    that no channel measures: the common factor of what is declared. A calibration moves these away from their declared
    value without a word, and what it gains by that is small: half the square of the deviations. Where everything else
    is explained, their number is a test of its own.

    Args:
      state: with standard errors.
      rate: the false-alarm rate of all such parameters together.
    """
    tested, strained = _tested_effects(state)
    if not strained or remainder.unexplained_channels(state):
        return None
    tried = [candidates.try_effect(state.bench, state.best, n) for n in strained]
    fitted = [contest.fit_fully(state.bench, state.best, c) for c in tried]
    deviations = [_deviations(state, c) for c in fitted]
    choice = fitted[int(np.argmax(deviations))]
    declaration = Declaration(max(deviations), rate, len(tested))
    judgement = CONTRADICTED.judge(declaration)
    if not judgement.passed:
        return None
    done = state.last or Round(())
    adopting = replace(
        done,
        ranked=(choice, *_others(done, choice, fitted)),
        judgements={**done.judgements, choice.name: (judgement,)},
        adopted=choice,
        bench=state.bench,
        p_value=rules.p_value_of(declaration),
    )
    return replace(state, rounds=(*state.adopting, adopting))


def _others(done: Round, choice: Candidate, strained: list[Candidate]) -> list[Candidate]:
    """The candidates of a round beside one whose declaration is contradicted, best first.

    What else may stand for the contradiction is compared by its fit. The scores of all others are below what they need,
    while this one needs none: they are not tied with it.
    """
    told = choice.score - rules.decisive_difference(choice.score)
    as_likely = {c.name: c for c in strained}
    others = [
        as_likely.get(c.name, replace(c, score=min(c.score, told)))
        for c in done.ranked
        if c.name != choice.name
    ]
    return sorted(others, key=lambda c: -c.score)


def _tested_effects(state: SearchState) -> tuple[list[str], list[str]]:
    """Effects that a declaration stands against, and those of them that can be beyond it: only these are fitted."""
    best, channels = state.best, state.bench.channels()
    replacing = [n for n in REGISTRY if _replaced_alone(n) in {u.name for u in best.unknowns if u.prior}]
    of_channels = [n for n in REGISTRY if _channel_parameters(best, n)]
    unmeasured = [
        n
        for n, effect in REGISTRY.items()
        if n not in (*of_channels, *best.model.effects) and effect.measured_by not in (None, *channels)
    ]
    strained = [n for n in replacing if candidates.strained_parameters(best, REGISTRY[n].replaces)]
    strained += [n for n in of_channels if _channel_parameters(best, n, candidates.STRAIN)]
    return [*replacing, *of_channels, *unmeasured], [*strained, *unmeasured]


def _replaced_alone(name: str) -> str | None:
    """The declared parameter that an effect is, without its prior; None for any other effect."""
    parameters = REGISTRY[name].parameters
    alone = len(parameters) == 1 and parameters[0].name in REGISTRY[name].replaces
    return parameters[0].name if alone else None


def _channel_parameters(best: Fit, name: str, least: float = 0.0) -> set[str]:
    """Parameters of an effect that is not in the model which are errors of channels, within a declared uncertainty.

    Only those errors count that the fit has moved by `least` standard deviations or more.
    """
    if name in best.model.effects:
        return set()
    moved = {
        (u.kind, u.name)
        for u, value in zip(best.unknowns, best.values, strict=True)
        if u.is_channel_error and abs(value - u.start) >= least * u.scale
    }
    return {p for p, errors in REGISTRY[name].channel_errors.items() if moved & set(errors)}


def _channel_deviations(best: Fit, candidate: Candidate) -> float:
    """Largest distance of such a parameter from neutral, in standard deviations of it and its declaration."""
    effect, fit = REGISTRY[candidate.name], candidate.fit
    own, neutral = (
        _channel_parameters(best, effect.name, candidates.STRAIN),
        effect.neutral(fit.model.declared),
    )
    replaced = effect.replaced_errors(fit.model.effects[effect.name])
    declared = {(str(u.kind), u.name): u.scale for u in best.unknowns if u.is_channel_error}
    distances = [
        abs(value - neutral[u.name])
        / math.hypot(error, *(declared.get(e, 0.0) for e in effect.channel_errors[u.name] if e in replaced))
        for u, value, error in zip(fit.unknowns, fit.values, fit.errors, strict=True)
        if u.effect == effect.name and u.name in own
    ]
    return max(distances, default=0.0)


def _relief(best: Fit, candidate: Candidate) -> float:
    """What an effect with one parameter saves in the priors of a fit, as a normal deviate: chi^2 = 2 * nat."""
    saved = prior_cost(best.unknowns, best.values) - prior_cost(candidate.fit.unknowns, candidate.fit.values)
    return math.sqrt(2 * max(saved, 0.0))


def _deviations(state: SearchState, candidate: Candidate) -> float:
    """Distance of an effect's value from the declared one, in standard deviations of their difference, log-normal."""
    name = candidate.name
    if _replaced_alone(name) is None:
        shown = bool(_channel_parameters(state.best, name))
        return _channel_deviations(state.best, candidate) if shown else _relief(state.best, candidate)
    declared = state.start.declared.declared.parameters[REGISTRY[name].replaces[0]]
    for u, value, error in zip(
        candidate.fit.unknowns, candidate.fit.values, candidate.fit.errors, strict=True
    ):
        if u.effect == name and value > 0 and declared.value > 0:
            spread = math.hypot(relative_uncertainty(declared), error / value)
            return abs(math.log(value / declared.value)) / spread
    return 0.0
