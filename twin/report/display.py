"""Formatted quantities and key sentences of a diagnosis, shared by page, terminal and rerun recording."""

from __future__ import annotations

import math
from collections.abc import Iterable

from twin import effects
from twin.diagnosis.answer import AdoptedEffect, ChannelError, Diagnosis, Prediction
from twin.labels import angle_in_degrees, join_with_and, over_noise, ratio, unit, with_error, words

MODELS = ("before", "calibrated", "after")
"""The declared, the calibrated and the final model, in the order of a diagnosis."""

NOISE_LIKE = 2.0
"""RMS residual over sensor noise up to which it counts as noise in tables and sentences [1]."""


def parameter_rows(effect: AdoptedEffect) -> list[tuple[str, str, str, str]]:
    """Returns (name, value with standard error, unit, degrees or "") of each parameter of an effect."""
    rows = []
    for name, value in effect.parameters.items():
        si = effect.units.get(name, "")
        shown = with_error(value, effect.standard_errors.get(name))
        rows.append((name, shown, unit(si), angle_in_degrees(value, si)))
    return rows


def by_role(diagnosis: Diagnosis, role: str) -> dict[str, Prediction]:
    """Returns the predictions of one role by file name."""
    return {file: p for file, p in diagnosis.predictions.items() if p.role == role}


def evaluated_predictions(diagnosis: Diagnosis) -> dict[str, Prediction]:
    """Returns the recordings on which the final model is evaluated: the held-out ones, or all if there are none."""
    return by_role(diagnosis, "holdout") or dict(diagnosis.predictions)


def worst_error(predictions: Iterable[Prediction], model: str) -> tuple[Prediction, str, float] | None:
    """Returns (recording, channel, error over noise) where `model` has the largest error; None without an error.

    Args:
      predictions: the recordings.
      model: "before", "calibrated" or "after".
    """
    errors = [
        (prediction, name, over_noise(getattr(error, model), error.noise))
        for prediction in predictions
        for name, error in prediction.errors.items()
    ]
    errors = [entry for entry in errors if math.isfinite(entry[2])]
    return max(errors, key=lambda entry: entry[2], default=None)


def remaining_errors(diagnosis: Diagnosis) -> list[tuple[str, str, ChannelError, float]]:
    """Returns (file, channel, error, error over noise) where the final error exceeds the noise, largest first."""
    rows = [
        (file, name, error, over_noise(error.after, error.noise))
        for file, prediction in evaluated_predictions(diagnosis).items()
        for name, error in prediction.errors.items()
    ]
    return sorted((row for row in rows if row[3] > NOISE_LIKE), key=lambda row: -row[3])


def headline(diagnosis: Diagnosis) -> str:
    """Returns the verdict in one plain sentence."""
    names = [words(e.name) for e in diagnosis.effects]
    if diagnosis.verdict == "explained":
        meaning = effects.meaning(diagnosis.effects[0].name) if len(names) == 1 else ""
        if meaning:
            return f"The model lacks {names[0]}: {meaning}."
        return f"The model lacks {join_with_and(names)}." if names else "The deviation is explained."
    if diagnosis.verdict == "no-missing-effect":
        return "Nothing is missing: the declared model, calibrated within its uncertainty, explains these recordings."
    if names:
        explain = "explains" if len(names) == 1 else "explain"
        return f"{join_with_and(names).capitalize()} {explain} part of it; the rest is outside the library."
    return "Something is missing that no effect in the library explains."


def improvement(diagnosis: Diagnosis) -> str:
    """Returns a sentence on the largest error over noise before and after; "" where nothing was simulated."""
    shown = evaluated_predictions(diagnosis)
    before, after = worst_error(shown.values(), "before"), worst_error(shown.values(), "after")
    if before is None or after is None:
        return ""
    what = "held-out recordings" if by_role(diagnosis, "holdout") else "fitted recordings (none was held out)"
    return (
        f"On the {what} the worst channel was off by {ratio(before[2])} times its sensor noise "
        f"with the declared model, and is off by {ratio(after[2])} times with the final one."
    )
