"""Formatted quantities and key sentences of a diagnosis, shared by page, terminal and rerun recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from twin import effects, labels
from twin.diagnosis import budget_text
from twin.diagnosis.answer import AdoptedEffect, ChannelError, Diagnosis, Patched, Prediction
from twin.diagnosis.error_budget import ChannelBudget
from twin.labels import angle_in_degrees, join_with_and, over_noise, ratio, unit, with_error, with_the, words

NOISE_LIKE = 2.0
"""RMS residual over sensor noise up to which it counts as noise in tables and sentences [1]."""


_MOST = 0.5
"""Share of the error of the calibrated model from which the effects explain "most" of it [1]."""


@dataclass(frozen=True)
class BudgetRow:
    """One channel of a recording in the table of the error budget; all errors formatted, in `unit`.

    Attributes:
      file: name of the recording.
      first: whether it is the first row of its recording.
      channel, unit: of the errors.
      in_windows: whether `models` are errors in windows, or of whole runs because there are no windows.
      models: of the declared model, of the calibrated one, and after each effect.
      whole: of whole runs, of the declared and of the final model.
      fit: of whole runs in per cent, of the declared and of the final model.
      noise: standard deviation of the sensor's noise.
      patched: error of whole runs of the final model with the lookup; "" without one.
    """

    file: str
    first: bool
    channel: str
    unit: str
    in_windows: bool
    models: tuple[str, ...]
    whole: tuple[str, str]
    fit: tuple[str, str]
    noise: str
    patched: str


def budget_rows(diagnosis: Diagnosis) -> list[BudgetRow]:
    """Returns the rows of the error budget of the recordings on which the final model is evaluated."""
    return [
        _budget_row(file, i == 0, name, p.budget, diagnosis.patched)
        for file, p in evaluated_predictions(diagnosis).items()
        for i, name in enumerate(p.budget)
    ]


def _budget_row(
    file: str, first: bool, name: str, budgets: Mapping[str, ChannelBudget], patched: Patched | None
) -> BudgetRow:
    budget, shown = budgets[name], labels.channel(name)
    in_windows = not all(math.isnan(e.rms_window) for e in budget.models)

    def said(value: float) -> str:
        return labels.number(shown.factor * value, 2)

    return BudgetRow(
        file,
        first,
        shown.label,
        shown.unit,
        in_windows,
        tuple(said(e.rms_window if in_windows else e.rms) for e in budget.models),
        (said(budget.before.rms), said(budget.after.rms)),
        (fit(budget.before.fit_percent), fit(budget.after.fit_percent)),
        said(budget.noise),
        said(patched.error(file, name)) if patched is not None and patched.errors else "",
    )


def fit(percent: float) -> str:
    """Returns a fit with one decimal above 90 %, where it tells; "–" where it does not exist."""
    if not math.isfinite(percent):
        return "–"
    return labels.signed(percent, 1 if percent > 90 else 0).removeprefix("+")


def budget_columns(diagnosis: Diagnosis) -> list[str]:
    """Returns the names of the models of the budget: before, calibrated, and each effect."""
    budgets = [b for p in evaluated_predictions(diagnosis).values() for b in p.budget.values()]
    return ["before", "calibrated", *(f"+ {words(name)}" for b in budgets[:1] for name, _ in b.steps)]


def parameter_rows(effect: AdoptedEffect) -> list[tuple[str, str, str, str]]:
    """Returns (name in words, value with standard error, unit, degrees or "") of each parameter of an effect."""
    rows = []
    for name, value in effect.parameters.items():
        si = effect.units.get(name, "")
        shown = with_error(value, effect.standard_errors.get(name), labels.PAGE_DIGITS)
        rows.append((labels.words(name), shown, unit(si), angle_in_degrees(value, si)))
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
        part = "most" if _share_by_effects(diagnosis) > _MOST else "part"
        return f"{labels.sentence(join_with_and(names))} {explain} {part} of it; the rest is outside the library."
    return "Something is missing that no effect in the library explains."


def _share_by_effects(diagnosis: Diagnosis) -> float:
    """Returns the share of the error of the calibrated model that the effects take away; 0 if it is unknown."""
    shown = evaluated_predictions(diagnosis).values()
    budget = budget_text.main_budget([p.budget for p in shown])
    return budget.share_by_effects if budget is not None else 0.0


def caveat(diagnosis: Diagnosis) -> str:
    """Returns what has to be settled first, and what stands against the verdict or what it does not say."""
    return " ".join(s for s in (*diagnosis.caveats, _caveat(diagnosis)) if s)


def dependence(diagnosis: Diagnosis) -> str:
    """What unexplained residuals depend on: "depends on the hub angle"; "" if that is unknown."""
    like = diagnosis.acts_like
    if like is not None:
        return labels.dependence(like.variables, like.place)
    return labels.dependence(diagnosis.depends_on) if diagnosis.depends_on else ""


def _caveat(diagnosis: Diagnosis) -> str:
    """What stands against the verdict, or what it does not say, in one sentence; "" beside caveats if nothing does."""
    if diagnosis.contradicted:
        return _contradiction(diagnosis)
    if diagnosis.verdict == "no-missing-effect":
        return (
            "What is smaller than these recordings can show, or within the declared uncertainty of the parameters, "
            "may still be there."
        )
    if diagnosis.verdict == "outside-library":
        left = dependence(diagnosis) or "follows no variable"
        return f"What is left {left}; these recordings show its size and not its cause."
    others = [name for effect in diagnosis.effects for name in rivals(diagnosis, effect.name)]
    if others:
        what = join_with_and([_with_meaning(name) for name in dict.fromkeys(others)])
        return f"But {what} would explain these recordings nearly as well."
    if not by_role(diagnosis, "holdout"):
        return "No recording was held out, so nothing tests this on data that it has not seen."
    return "" if diagnosis.caveats else "No other effect of the library explains these recordings as well."


def _contradiction(diagnosis: Diagnosis) -> str:
    worst = diagnosis.contradicted[0]
    prediction = diagnosis.predictions.get(worst.recording)
    error = prediction.errors.get(worst.channel) if prediction else None
    size = (
        f" by {labels.amount(worst.channel, worst.size * error.noise)}, where "
        f"{labels.amount(worst.channel, worst.limit * error.noise)} was the most to be expected"
        if error is not None
        else ""
    )
    return (
        f"The fitted recordings are explained, but not {worst.recording}, which was held out: "
        f"{with_the(worst.channel)} is off{size}."
    )


def _with_meaning(name: str) -> str:
    meaning = effects.meaning(name)
    return f"{words(name)} ({meaning})" if meaning else words(name)


def rivals(diagnosis: Diagnosis, name: str) -> list[str]:
    """Returns the effects that the recordings cannot tell from an adopted one, without other adopted ones."""
    adopted = {effect.name for effect in diagnosis.effects}
    sets = [names for names in diagnosis.indistinguishable if name in names]
    return list(dict.fromkeys(other for names in sets for other in names if other not in adopted))


def counted(diagnosis: Diagnosis) -> str:
    """Returns how many recordings were fitted and held out, as words."""
    held_out, fit = (len(by_role(diagnosis, role)) for role in ("holdout", "fit"))
    return f"{fit} fitted recording{'s' * (fit != 1)} and {held_out} that {'were' if held_out != 1 else 'was'} held out"


def unknown_zeros(diagnosis: Diagnosis) -> str:
    """Returns a sentence on the channels whose unknown zero is in no error and no figure; "" for none."""
    names = [name for p in diagnosis.predictions.values() for name in p.unknown_zeros]
    if not names:
        return ""
    shown = join_with_and([with_the(name) for name in dict.fromkeys(names)])
    return f"The zero of {shown} is unknown and was taken out."


def telling_channel(diagnosis: Diagnosis) -> tuple[str, str] | None:
    """Returns the recording and channel that show best what was found, or what is left; None without any.

    It is that of a contradiction, or outside the library the one with the largest final error; else the hub angle with
    the largest error of the declared model, or another channel where the hub angle is nowhere predicted.
    """
    for contradiction in diagnosis.contradicted:
        if contradiction.channel in getattr(diagnosis.predictions.get(contradiction.recording), "errors", {}):
            return contradiction.recording, contradiction.channel
    outside = diagnosis.verdict == "outside-library"
    model = "after" if outside else "before"
    rows = [
        (not outside and name == "hub_angle", _sized(getattr(error, model), error.noise), file, name)
        for file, prediction in evaluated_predictions(diagnosis).items()
        for name, error in prediction.errors.items()
        if name in prediction.after and math.isfinite(getattr(error, model))
    ]
    return max(rows)[2:] if rows else None


def _sized(error: float, noise: float) -> float:
    """The error over the noise; where that is unknown, less than any that is known."""
    over = over_noise(error, noise)
    return over if math.isfinite(over) else -1.0


def line_names(diagnosis: Diagnosis) -> dict[str, str]:
    """Returns the names of the measured line, and of those of the declared and of the final model."""
    names = [words(effect.name) for effect in diagnosis.effects]
    after = f"after: with {join_with_and(names)}" if names else "after: calibrated"
    return {"measured": "measured", "before": "before: as declared", "after": after}


_WORSE_FACTOR = 1.05  # error over that of the declared model from which another model counts as worse [1]


def degradations(held_out: Mapping[str, Prediction]) -> str:
    """Returns a sentence on held-out errors that grew from the declared model on, and why that can be; "" for none."""
    places: list[str] = []
    reach = by_gaps = 0.0
    for model in ("calibrated", "after"):
        for file, prediction in held_out.items():
            worse = {n: e for n, e in prediction.errors.items() if _clearly_worse(e, model)}
            if worse:
                channels = ", ".join(labels.channel(name).label for name in worse)
                places.append(f"{model} on {file} ({channels})")
                reach = max([reach, *(over_noise(e.reach, e.noise) for e in worse.values())])
                by_gaps = max([by_gaps, *(over_noise(e.by_gaps, e.noise) for e in worse.values())])
    if not places:
        return ""
    sensitivity = f": one that is off by 0.1 % changes these by up to {ratio(reach)} times the noise"
    return (
        f"Worse than before: {'; '.join(places)}. That can happen: parameters are fitted to the torque balance at each "
        "instant, those of a model that still lacks something compensate for it, and in a free-running simulation one "
        "more stick or slip, which depends on small changes of the break-away torque, shifts everything after it"
        f"{sensitivity if reach > NOISE_LIKE else ''}.{_lost_commands(by_gaps)}"
    )


def _clearly_worse(error: ChannelError, model: str) -> bool:
    value = getattr(error, model)
    return over_noise(value, error.noise) > NOISE_LIKE and value > _WORSE_FACTOR * error.before


def large_fitted_errors(fit: Mapping[str, Prediction]) -> str:
    """Returns sentences on what large errors of the final model on fitted recordings mean; "" without such errors."""
    large = [
        (over_noise(e.after, e.noise), file, name)
        for file, p in fit.items()
        for name, e in p.errors.items()
        if over_noise(e.after, e.noise) > NOISE_LIKE
    ]
    if not large:
        return ""
    size, file, name = max(large)
    error = fit[file].errors[name]
    reach = over_noise(error.reach, error.noise)
    sensitive = (
        f" In {file}, {with_the(name)} is off by {ratio(size)} times the noise, and a break-away torque that is off "
        f"by 0.1 % alone changes it by {ratio(reach)} times."
        if reach > NOISE_LIKE
        else ""
    )
    return (
        "A large error need not contradict the fit: here a recording is simulated to its end from its first sample "
        "and its command alone, sticks and slips add up, and one more of them shifts everything after it."
        f"{sensitive}{_lost_commands(over_noise(error.by_gaps, error.noise))}"
    )


def _lost_commands(by_gaps: float) -> str:
    """Returns a sentence on what other commands in missing rows change [noise levels]; "" where that is little."""
    if by_gaps <= NOISE_LIKE:
        return ""
    return (
        " Rows are missing, and commands with them; other commands there change the simulation by up to "
        f"{ratio(by_gaps)} times the noise."
    )


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
