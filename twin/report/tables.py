"""Tables of the report of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from twin import effects, labels
from twin.diagnosis.answer import ChannelError, Diagnosis, Patched, Prediction
from twin.diagnosis.rules import RULES
from twin.report import certainty, display
from twin.report.pages import Cell, Row, Table

_FAR = 2.0  # declared standard deviations from which a fitted parameter is far from its declared value


def recordings(diagnosis: Diagnosis) -> Table:
    """Returns what was recorded."""
    columns = ("recording", "used for", ">duration", ">samples", "channels", "conditions")
    return Table(columns, [_recording(file, p) for file, p in diagnosis.predictions.items()])


def _recording(file: str, prediction: Prediction) -> Row:
    measured = prediction.measured
    missing = {
        labels.channel(name).label: float(np.mean(np.isnan(measured[name]))) for name in measured.measured()
    }
    gaps = [f"{label} {_percent(share)} missing" for label, share in missing.items() if share > 0]
    traits = ["hub locked" if measured.clamped else "hub free", f"{measured.loop} loop"]
    if measured.initial_tip_deflection is not None:
        traits.append(f"tip released from {1e3 * measured.initial_tip_deflection:.3g} mm")
    if measured.start == "unknown":
        traits.append("already moving at the start")
    return (
        Cell(file, strong=True),
        "held out" if prediction.role == "holdout" else "fit",
        f"{measured.duration:.3g} s",
        f"{len(measured):,}".replace(",", "\u202f"),
        ", ".join(labels.channel(name).label for name in measured.measured()),
        ", ".join(traits + gaps),
    )


def _percent(share: float) -> str:
    if share < 0.001:
        return "< 0.1 %"
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


# Errors


def errors(predictions: Mapping[str, Prediction]) -> Table:
    """Returns the errors of each channel over whole recordings, in its unit, and that of the final model over noise."""
    rows: list[Row] = []
    groups = {}
    for file, prediction in predictions.items():
        if prediction.errors:
            groups[len(rows)] = file
        rows += [_errors_row(prediction, name, error) for name, error in prediction.errors.items()]
    columns = ("channel", ">before", ">calibrated", ">after", ">fit", ">sensor noise", ">after, over noise")
    return Table(columns, rows, groups)


def _errors_row(prediction: Prediction, name: str, error: ChannelError) -> Row:
    over, budget = labels.over_noise(error.after, error.noise), prediction.budget.get(name)
    return (
        labels.channel(name).label,
        *(labels.amount(name, getattr(error, model)) for model in ("before", "calibrated")),
        Cell(labels.amount(name, error.after), strong=True),
        _fit(budget.after.fit_percent) if budget is not None else "–",
        labels.amount(name, error.noise),
        Cell(labels.ratio(over), warns=over > display.NOISE_LIKE),
    )


def _fit(percent: float) -> str:
    text = display.fit(percent)
    return text if text == "–" else f"{text} %"


def budget(diagnosis: Diagnosis) -> Table:
    """Returns what each step takes away of the error in windows."""
    rows: list[Row] = []
    groups = {}
    for row in display.budget_rows(diagnosis):
        if row.first:
            groups[len(rows)] = row.file
        *steps, last = row.models
        name = Cell(f"{row.channel} [{row.unit}]", note="" if row.in_windows else "whole run")
        rows.append((name, *steps, Cell(last, strong=True), *row.fit, row.noise))
    models = tuple(f">{name}" for name in display.budget_columns(diagnosis))
    return Table(("channel", *models, ">fit before [%]", ">fit after [%]", ">sensor noise"), rows, groups)


def patch(patched: Patched) -> Table:
    """Returns the errors of held-out recordings without and with a lookup."""
    rows: list[Row] = [
        (
            Cell(file, strong=True),
            labels.channel(name).label,
            labels.amount(name, without),
            labels.amount(name, corrected),
            f"{corrected / without:.2f}" if without > 0 else "",
        )
        for file, channels in patched.errors.items()
        for name, (without, corrected) in channels.items()
    ]
    return Table(("held-out recording", "channel", ">error without", ">with the patch", ">ratio"), rows)


# Candidates


def numbers(d: Diagnosis) -> Table:
    """Returns probabilities, scores and thresholds, each with what it means."""
    half = ", half of it reserved for causes outside the library" if d.verdict == "outside-library" else ""
    rows: list[Row] = [
        (
            f"probability of {labels.words(effect.name)}",
            Cell(labels.probability(effect.probability), strong=True),
            f"among the candidates tried and chance{half}",
        )
        for effect in d.effects
    ]
    best = certainty.best_score(d)
    if best is not None:
        rows.append(("best score", Cell(_score(best[1]), strong=True), _score_means(best[0])))
    if d.by_chance is not None and d.false_alarm_rate is not None:
        rate = f"{100 * d.false_alarm_rate:.3g} %"
        means = (
            f"where nothing is missing, chance alone exceeds it in {rate} of all cases, the false-alarm rate"
        )
        rows.append(("threshold by chance", Cell(_score(d.by_chance), strong=True), means))
    if d.least_score is not None:
        means = "whatever chance gives, because the discretisation error of the model has a score, too"
        below = bool(d.effects) and best is not None and best[1] < d.least_score
        exception = (
            "; the adopted effect scores less, but a function of no known effect shows that something is missing"
            if below
            else ""
        )
        rows.append(("least threshold", Cell(f"{d.least_score:g}", strong=True), means + exception))
    return Table(("number", ">value", "what it means"), rows)


def _score_means(name: str) -> str:
    return f"{labels.words(name)}: gain in log likelihood by this candidate alone, less the penalty for its parameters"


def alternatives(diagnosis: Diagnosis) -> Table:
    """Returns each candidate that was fitted and not adopted, its nearest round, and why."""
    adopted, idle = {effect.name for effect in diagnosis.effects}, set(diagnosis.never_fitted)
    rows: list[Row] = [
        (
            Cell(labels.words(name), note=effects.meaning(name)),
            _round(diagnosis, name),
            certainty.why_not(diagnosis, name),
        )
        for name, _ in diagnosis.ranking
        if name not in adopted | idle
    ]
    return Table(("candidate", ">round", "why it was turned down"), rows)


def _round(diagnosis: Diagnosis, name: str) -> str:
    return str(diagnosis.nearest_round(name) or 1)


def scores(diagnosis: Diagnosis) -> Table:
    """Returns the score of each fitted candidate in its nearest round, as a bar too, and the rule that it failed."""
    idle = set(diagnosis.never_fitted)
    fitted = [(n, diagnosis.score(n)) for n, _ in diagnosis.ranking if n not in idle]
    fitted = [(name, score) for name, score in fitted if math.isfinite(score)]
    top = max([diagnosis.threshold or 0.0, *(score for _, score in fitted)])
    adopted = {effect.name for effect in diagnosis.effects}
    rows: list[Row] = [
        (
            Cell(labels.words(name), strong=name in adopted),
            _round(diagnosis, name),
            Cell(_score(score), strong=name in adopted),
            Cell("", width=100 * max(score, 0.0) / top if top > 0 else 0.0),
            "adopted" if name in adopted else _rule(diagnosis, name),
        )
        for name, score in fitted
    ]
    return Table(("candidate", ">round", ">score", "", "rule that it failed"), rows)


def _rule(diagnosis: Diagnosis, name: str) -> str:
    failed = diagnosis.failed_rule(name)
    if failed is None:
        return ""
    rule = RULES[failed.judgement.rule]
    needed = "more than" if rule.above else "at least" if rule.at_least else "at most"
    value, limit = (
        f"{v:.0f}" if v == round(v) else _score(v) for v in (failed.judgement.value, failed.judgement.limit)
    )
    withdrawn = "Withdrawn after it was adopted. " if failed.round is None else ""
    return f"{withdrawn}{rule.asks} No: {value}; {needed} {limit} is required."


def _score(score: float) -> str:
    return labels.signed(score, 0 if abs(score) >= 100 else 1).removeprefix("+")


# Parameters


def calibrated(diagnosis: Diagnosis) -> Table:
    """Returns declared and fitted parameters."""
    columns = ("parameter", ">declared", ">uncertainty", ">fitted", "unit", ">change", ">in declared σ")
    return Table(columns, [_calibrated(name, diagnosis) for name in diagnosis.calibrated])


def _calibrated(name: str, diagnosis: Diagnosis) -> Row:
    moved = diagnosis.calibrated[name]
    sigma, uncertainty = _declared_deviation(name, diagnosis)
    change = moved.fitted - moved.declared
    far = Cell(labels.signed(change / sigma, 1), warns=abs(change) > _FAR * sigma) if sigma > 0 else "–"
    return (
        labels.parameter(name),
        labels.number(moved.declared, 4),
        uncertainty,
        labels.with_error(moved.fitted, moved.standard_error, labels.PAGE_DIGITS),
        labels.unit(moved.unit),
        f"{labels.signed(100 * change / moved.declared, 1)} %" if moved.declared else "–",
        far,
    )


def _declared_deviation(name: str, diagnosis: Diagnosis) -> tuple[float, str]:
    """Returns the declared standard deviation of a parameter [SI], and how it is shown; 0 where there is none."""
    moved = diagnosis.calibrated[name]
    if moved.uncertainty is not None and not moved.declared:
        return moved.uncertainty, f"{labels.number(moved.uncertainty)} {labels.unit(moved.unit)}"
    parameter = diagnosis.declared.parameters.get(name)
    relative = moved.uncertainty if parameter is None else parameter.uncertainty
    if relative is None:
        return 0.0, "not declared"
    return abs(moved.declared) * relative, f"{100 * relative:.3g} %"
