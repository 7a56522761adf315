"""How sure a diagnosis is, in words: whether something is missing, whether it is this, whether it predicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from twin import labels
from twin.diagnosis.answer import Diagnosis
from twin.report import display

_BEYOND_DOUBT = 3.0
"""Score over its threshold from which chance and the model's own error are out of the question [1]."""
_ALMOST, _VERY, _PROBABLY = 0.99, 0.9, 0.6  # probabilities from which a cause is called so

REASONS: Mapping[str, str] = {
    "large-score-test": "A quick test promised less of it than of those that were fitted.",
    "best-of-round": "Another candidate explains more.",
    "exceeds-chance": "It gains no more than chance gives.",
    "exceeds-model-error": "It gains no more than the discretisation error of the model, effects included.",
    "explains-a-share": "It explains too small a share of the misfit.",
    "gains-elsewhere": "It does not improve the prediction of recordings that its fit did not use.",
    "needed-beside-later": "It was no longer needed beside the effects found after it.",
    "best-beside-later": "Beside the effects found after it, another candidate explains more.",
    "declaration-contradicted": "The recordings agree with the declared value within its uncertainty.",
    "size-is-determined": "These recordings do not determine its size: it may imitate another fault.",
}
"""Rule -> why a candidate that fails it is turned down."""


@dataclass(frozen=True)
class Answer:
    """A question about a diagnosis, its answer in a few words, and why."""

    question: str
    answer: str
    why: str


def answers(diagnosis: Diagnosis) -> list[Answer]:
    """Returns the questions that decide how far a diagnosis is to be trusted."""
    return [
        Answer("Is something missing?", *_missing(diagnosis)),
        *_cause(diagnosis),
        Answer("Does the model predict what it has not seen?", *_predicts(diagnosis)),
    ]


def best_score(d: Diagnosis) -> tuple[str, float] | None:
    """Returns the best candidate of the first round and its score; None without any."""
    scores = [(name, score) for name, score in d.ranking if math.isfinite(score)]
    return max(scores, key=lambda entry: entry[1], default=None)


def why_not(diagnosis: Diagnosis, name: str) -> str:
    """Returns why a candidate was turned down."""
    if any(name in names and _rivals(diagnosis, names) for names in diagnosis.indistinguishable):
        return "It explains these recordings nearly as well: not told apart."
    failed = diagnosis.failed_rule(name)
    if failed is not None:
        return REASONS[failed.judgement.rule]
    if name in diagnosis.not_fitted:
        return REASONS["large-score-test"]
    return REASONS["best-of-round"] if diagnosis.effects else "It gains too little."


def _rivals(diagnosis: Diagnosis, names: tuple[str, ...]) -> bool:
    return any(effect.name in names for effect in diagnosis.effects)


def _missing(d: Diagnosis) -> tuple[str, str]:
    best, rate = best_score(d), d.false_alarm_rate
    alarm = (
        f" Where nothing is missing, an alarm is raised in {100 * rate:.3g} % of campaigns." if rate else ""
    )
    if d.verdict == "no-missing-effect":
        if best is None:
            return "Not that these recordings show.", f"No candidate was needed.{alarm}"
        reason = why_not(d, best[0]) if d.failed_rule(best[0]) else ""
        return (
            "Not that these recordings show.",
            f"The best candidate was {labels.words(best[0])}. {reason}".rstrip() + alarm,
        )
    if d.contradicted and not d.effects:
        return "Probably.", "The fitted recordings are explained, but a held-out one contradicts the model."
    if not d.effects:
        return "Yes.", f"What the model leaves is larger than the noise of the sensors.{alarm}"
    beyond = best is not None and bool(d.threshold) and best[1] > _BEYOND_DOUBT * (d.threshold or math.inf)
    if beyond:
        return (
            "Beyond doubt.",
            f"What was found gains far more than chance can, or an error of the model.{alarm}",
        )
    return "Yes.", f"What was found gains more than chance does, and more than an error of the model.{alarm}"


def _cause(d: Diagnosis) -> list[Answer]:
    if d.verdict == "no-missing-effect":
        return []
    if not d.effects:
        return [
            Answer(
                "Which cause is it?", "None that has a name here.", "No effect of the library explains it."
            )
        ]
    found = []
    for effect in d.effects:
        rivals = display.rivals(d, effect.name)
        word = _likely(effect.probability, bool(rivals))
        given = "" if not math.isfinite(effect.probability) else f"{labels.probability(effect.probability)}"
        why = f"Probability among all candidates tried: {given}." if given else ""
        if rivals:
            why += f" {labels.sentence(labels.join_with_and([labels.words(n) for n in rivals]))} would explain these "
            why += "recordings nearly as well."
        if d.verdict == "outside-library":
            why += (
                " It may imitate a part of a cause that the library does not know: its probability is halved."
            )
        found.append(Answer(f"Is it {labels.words(effect.name)}?", word, why.strip()))
    return found


def _likely(probability: float, has_rivals: bool) -> str:
    for limit, word in ((_ALMOST, "Almost certainly."), (_VERY, "Very probably."), (_PROBABLY, "Probably.")):
        if probability >= limit and not (has_rivals and limit > _PROBABLY):
            return word
    return "Perhaps."


def _predicts(d: Diagnosis) -> tuple[str, str]:
    held_out = display.by_role(d, "holdout")
    errors = [labels.over_noise(e.after, e.noise) for p in held_out.values() for e in p.errors.values()]
    known = [over for over in errors if math.isfinite(over)]
    if not held_out:
        return "Not tested.", "No recording was held out."
    if not known:
        return "Not known.", "No error could be compared with the noise of a sensor."
    good = sum(over <= display.NOISE_LIKE for over in known)
    why = (
        f"{good} of {len(known)} channels of the held-out recordings are within twice the noise of their sensor, "
        "each simulated to its end from its first sample and its command alone."
    )
    words = {len(known): "Yes, down to the noise of the sensors.", 0: "No."}
    return words.get(good, "Mostly." if good > len(known) / 2 else "In part."), why
