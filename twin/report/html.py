"""The report of a diagnosis as one HTML page that needs no network and can be printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin import labels
from twin.diagnosis.answer import AdoptedEffect, ChannelError, Diagnosis, Patched, Prediction, Trace
from twin.diagnosis.rules import RULES
from twin.effects import meaning
from twin.files.whole import write_file
from twin.recording import CHANNEL_UNITS
from twin.report import display, figures, pages
from twin.report.figures import Figure

_WORSE_FACTOR = 1.05  # error over that of the declared model from which another model counts as worse [1]
_LINE_POINTS = {"holdout": 2000, "fit": 1000}  # of a line; fewer for the fit recordings, which are many


def write_report(diagnosis: Diagnosis, path: Path, files: Mapping[str, str] | None = None) -> None:
    """Writes a diagnosis as one HTML file that needs nothing else.

    Args:
      diagnosis: what is reported.
      path: the file; it is overwritten.
      files: name of each file of the same folder -> what it is.

    Raises:
      InputError: the file cannot be written.
    """
    write_file(Path(path), render(diagnosis, files))


def render(diagnosis: Diagnosis, files: Mapping[str, str] | None = None) -> str:
    """Returns the page; arguments as `write_report`."""
    return pages.render(
        "report/report.html.j2",
        filters={"words": labels.words, "ratio": labels.ratio, "probability": labels.probability},
        page=_content(diagnosis),
        files=files or {},
        d=diagnosis,
    )


@dataclass(frozen=True)
class ErrorRow:
    """One row of the error table.

    Attributes:
      file, channel: of the error.
      first: whether it is the first row of its recording.
      span: number of rows of the recording.
      models: "before", "calibrated", "after" -> (error over noise, formatted error).
      noise: formatted.
      places: model -> position on the bar, from 0 to 100.
    """

    file: str
    channel: str
    first: bool
    span: int
    models: Mapping[str, tuple[float, str]]
    noise: str
    places: Mapping[str, float]


def _content(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the template, by name."""
    held_out, fit = display.by_role(diagnosis, "holdout"), display.by_role(diagnosis, "fit")
    scale = _Scale(diagnosis)
    return {
        "headline": display.headline(diagnosis),
        "improvement": display.improvement(diagnosis),
        "facts": _facts(diagnosis),
        "recordings": [_recording(file, p) for file, p in diagnosis.predictions.items()],
        "first_miss": _largest_initial_error(diagnosis),
        "held_out_errors": list(_error_rows(held_out, scale)),
        "worse": _degradations(held_out),
        "fit_errors": list(_error_rows(fit, scale)),
        "scale": scale,
        "effects": [_effect(effect) for effect in diagnosis.effects],
        "ranking": _ranking(diagnosis),
        "decision": _decision(diagnosis),
        "traces": list(_traces(diagnosis)),
        "held_out": list(_recordings(held_out)),
        "fit": list(_recordings(fit)),
        "remaining": _remaining(diagnosis),
        "unknown_noise": _unknown_noise(diagnosis),
        "depends_on": [labels.variable(name).label for name in diagnosis.depends_on],
        "indistinguishable": [[labels.words(n) for n in names] for names in diagnosis.indistinguishable],
        "patch": _patch(diagnosis.patched),
        "calibrated": [_calibrated(name, diagnosis) for name in diagnosis.calibrated],
    }


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    held_out, fit = display.by_role(diagnosis, "holdout"), display.by_role(diagnosis, "fit")
    facts = [("recordings", f"{len(fit)} fitted, {len(held_out)} held out")]
    for model, label in (("before", "worst error before"), ("after", "worst error after")):
        largest = display.worst_error(display.evaluated_predictions(diagnosis).values(), model)
        if largest:
            facts.append((label, f"{labels.ratio(largest[2])} × noise"))
    if diagnosis.wall_s > 0:
        facts.append(("computed in", f"{diagnosis.wall_s:.0f} s"))
    return facts


def _recording(file: str, prediction: Prediction) -> dict[str, str]:
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
    return {
        "file": file,
        "role": "held out" if prediction.role == "holdout" else "fit",
        "duration": f"{measured.duration:.3g} s",
        "samples": f"{len(measured):,}".replace(",", "\u202f"),
        "channels": ", ".join(labels.channel(name).label for name in measured.measured()),
        "traits": ", ".join(traits + gaps),
    }


def _percent(share: float) -> str:
    if share < 0.001:
        return "< 0.1 %"
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _largest_initial_error(diagnosis: Diagnosis) -> dict[str, str] | None:
    """Returns the largest error over noise of the declared model; None without an error."""
    largest = display.worst_error(display.evaluated_predictions(diagnosis).values(), "before")
    if largest is None:
        return None
    prediction, name, over = largest
    file = next(file for file, p in diagnosis.predictions.items() if p is prediction)
    error = labels.amount(name, prediction.errors[name].before)
    return {"file": file, "channel": labels.channel(name).label, "over": labels.ratio(over), "error": error}


# Errors over noise, with a bar


class _Scale:
    """Logarithmic axis of error over noise, for the bars of the error table.

    Attributes:
      low, high: decadic logarithms of its ends.
      ticks: (value, position) of each decade.
      noise: position up to which an error counts as noise.
    """

    def __init__(self, diagnosis: Diagnosis):
        errors = [e for p in diagnosis.predictions.values() for e in p.errors.values()]
        ratios = [labels.over_noise(getattr(e, m), e.noise) for e in errors for m in display.MODELS]
        finite = [value for value in ratios if math.isfinite(value) and value > 0]
        self.low = math.log10(min(0.5, *finite)) if finite else 0.0
        self.high = math.log10(max(20.0, *finite)) + 0.05 if finite else 1.0
        self.ticks = [
            (10**k, self.place(10**k)) for k in range(math.ceil(self.low), math.floor(self.high) + 1)
        ]
        self.noise = self.place(display.NOISE_LIKE)

    def place(self, value: float) -> float:
        """Returns the position of a value, from 0 to 100; NaN for one that is not positive."""
        if not (math.isfinite(value) and value > 0):
            return math.nan
        return 100 * (math.log10(value) - self.low) / (self.high - self.low)


def _error_rows(predictions: Mapping[str, Prediction], scale: _Scale) -> Iterator[ErrorRow]:
    for file, prediction in predictions.items():
        for i, (name, error) in enumerate(prediction.errors.items()):
            models = {m: _error_cell(name, error, m) for m in display.MODELS}
            places = {m: scale.place(over) for m, (over, _) in models.items() if scale.place(over) >= 0}
            label, noise = labels.channel(name).label, labels.amount(name, error.noise)
            yield ErrorRow(file, label, i == 0, len(prediction.errors), models, noise, places)


def _error_cell(name: str, error: ChannelError, model: str) -> tuple[float, str]:
    value = getattr(error, model)
    return labels.over_noise(value, error.noise), labels.amount(name, value)


def _degradations(held_out: Mapping[str, Prediction]) -> str:
    """Returns a sentence on held-out errors that grew from the declared model on, and why that can be; "" for none."""
    places: list[str] = []
    reach = 0.0
    for model in ("calibrated", "after"):
        for file, prediction in held_out.items():
            errors = {n: e for n, e in prediction.errors.items() if _clearly_worse(e, model)}
            if errors:
                channels = ", ".join(labels.channel(name).label for name in errors)
                places.append(f"{model} on {file} ({channels})")
                reach = max([reach, *(labels.over_noise(e.reach, e.noise) for e in errors.values())])
    if not places:
        return ""
    sensitivity = f": one that is off by 0.1 % changes these by up to {labels.ratio(reach)} times the noise"
    return (
        f"Worse than before: {'; '.join(places)}. That can happen: parameters are fitted to the torque balance at each "
        "instant, those of a model that still lacks something compensate for it, and in a free-running simulation one "
        "more stick or slip, which depends on small changes of the break-away torque, shifts everything after it"
        f"{sensitivity if reach > display.NOISE_LIKE else ''}."
    )


def _clearly_worse(error: ChannelError, model: str) -> bool:
    value = getattr(error, model)
    return labels.over_noise(value, error.noise) > display.NOISE_LIKE and value > _WORSE_FACTOR * error.before


# What explains it


def _effect(effect: AdoptedEffect) -> dict[str, Any]:
    return {
        "name": labels.words(effect.name),
        "meaning": meaning(effect.name),
        "probability": labels.probability(effect.probability),
        "parameters": [
            (labels.words(name), value, unit, degrees)
            for name, value, unit, degrees in display.parameter_rows(effect)
        ],
    }


def _ranking(diagnosis: Diagnosis, most: int = 12) -> dict[str, Any]:
    """Returns the rows of the fitted candidates, the names of the others, and the position of the threshold."""
    idle = set(diagnosis.not_fitted)
    fitted = [(n, score) for n, score in diagnosis.ranking if math.isfinite(score) and n not in idle]
    least = diagnosis.threshold or 0.0
    top = max([least, *(score for _, score in fitted)])
    adopted = {effect.name for effect in diagnosis.effects}
    rows = [
        {
            "name": labels.words(name),
            "score": _score(score),
            "width": 100 * max(score, 0.0) / top if top > 0 else 0.0,
            "adopted": name in adopted,
            "rule": _rejection(diagnosis, name),
        }
        for name, score in fitted[:most]
    ]
    return {
        "rows": rows,
        "more": max(len(fitted) - most, 0),
        "not_fitted": [labels.words(n) for n, _ in diagnosis.ranking if n in idle],
        "least": 100 * least / top if least > 0 else None,
    }


def _rejection(diagnosis: Diagnosis, name: str) -> dict[str, str] | None:
    """Returns the rule by which a candidate was rejected, with its question, statistic and limit; None without one."""
    rejected = diagnosis.failed_rule(name)
    if rejected is None:
        return None
    rule = RULES[rejected.judgement.rule]
    sign = "<" if rule.at_least else ">"
    value, limit = (labels.number(v) for v in (rejected.judgement.value, rejected.judgement.limit))
    return {"name": rule.name, "asks": rule.asks, "said": f"{value} {sign} {limit}"}


def _decision(d: Diagnosis) -> dict[str, str | bool] | None:
    """Returns the best score of the first round and the thresholds that it is compared with; None if unknown."""
    scores = [score for _, score in d.ranking if math.isfinite(score)]
    if not scores or d.by_chance is None or d.false_alarm_rate is None or d.least_score is None:
        return None
    return {
        "best": _score(max(scores)),
        "chance": _score(d.by_chance),
        "least": f"{d.least_score:g}",
        "rate": f"{100 * d.false_alarm_rate:.3g} %",
        "below": bool(d.effects) and max(scores) < d.least_score,
    }


def _score(score: float) -> str:
    text = f"{score:.0f}" if abs(score) >= 100 else f"{score:.1f}"
    return text.replace("-", "−")


def _traces(diagnosis: Diagnosis) -> Iterator[dict[str, Any]]:
    axis = figures.JoinedTime.of(diagnosis.traces)
    for trace in diagnosis.traces:
        yield _trace(diagnosis, trace, axis)


def _trace(diagnosis: Diagnosis, trace: Trace, axis: figures.JoinedTime) -> dict[str, Any]:
    against = _explaining_variable(diagnosis, trace)
    return {
        "label": labels.unmodelled(trace.channel).label,
        "against": labels.variable(against).label if against else None,
        "explained": against is not None and trace.explained_by == against,
        "fitted": trace.fitted is not None,
        "figure": figures.trace_figure(trace, against, axis),
        "others": figures.other_variables_figure(trace, against),
    }


def _explaining_variable(diagnosis: Diagnosis, trace: Trace) -> str | None:
    candidates = (trace.explained_by, *diagnosis.depends_on)
    return next((name for name in candidates if name and name in trace.variables and name != "time"), None)


def _patch(patched: Patched | None) -> dict[str, Any] | None:
    if patched is None:
        return None
    patch = patched.patch
    hub = patch.channel not in CHANNEL_UNITS
    return {
        "place": "the torque on the hub" if hub else f"the reading of {labels.channel(patch.channel).label}",
        "variable": labels.variable(patch.variable).label,
        "figure": figures.patch_figure(patched),
        "rows": [
            {
                "file": file,
                "channel": labels.channel(name).label,
                "without": labels.amount(name, without),
                "with": labels.amount(name, corrected),
                "ratio": f"{corrected / without:.2f}" if without > 0 else "",
            }
            for file, channels in patched.errors.items()
            for name, (without, corrected) in channels.items()
        ],
    }


# Recordings


def _recordings(predictions: Mapping[str, Prediction]) -> Iterator[tuple[str, Prediction, Figure | None]]:
    for file, prediction in predictions.items():
        yield file, prediction, figures.recording_figure(prediction, _LINE_POINTS[prediction.role])


# What remains


def _remaining(diagnosis: Diagnosis) -> list[dict[str, str]]:
    rows = display.remaining_errors(diagnosis)
    return [
        {
            "file": file,
            "channel": labels.channel(name).label,
            "over": labels.ratio(over),
            "error": labels.amount(name, error.after),
            "share": _share(error),
        }
        for file, name, error, over in rows
    ]


def _share(error: ChannelError) -> str:
    """Returns the squared error of the final model over that of the declared one."""
    if not error.before > 0:
        return "–"
    return _percent((error.after / error.before) ** 2)


def _unknown_noise(diagnosis: Diagnosis) -> list[str]:
    names = {
        labels.channel(name).label: None
        for prediction in diagnosis.predictions.values()
        for name, error in prediction.errors.items()
        if math.isnan(labels.over_noise(1.0, error.noise))
    }
    return list(names)


def _calibrated(name: str, diagnosis: Diagnosis) -> dict[str, str]:
    moved = diagnosis.calibrated[name]
    parameter = diagnosis.declared.parameters.get(name)
    uncertainty = parameter.uncertainty if parameter else None
    sigma = abs(moved.declared) * uncertainty if uncertainty else 0.0
    change = moved.fitted - moved.declared
    return {
        "name": labels.words(name).replace(".", ": "),
        "declared": labels.number(moved.declared, 4),
        "fitted": labels.with_error(moved.fitted, moved.standard_error),
        "unit": labels.unit(moved.unit),
        "change": f"{100 * change / moved.declared:+.1f} %".replace("-", "−") if moved.declared else "–",
        "sigmas": f"{change / sigma:+.1f}".replace("-", "−") if sigma > 0 else "–",
        "uncertainty": f"{100 * uncertainty:.3g} %" if uncertainty is not None else "not declared",
        "far": "far" if sigma > 0 and abs(change) > 2 * sigma else "",
    }
