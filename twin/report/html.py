"""The report of a diagnosis as one HTML page that needs no network and can be printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from twin import labels
from twin.diagnosis.answer import AdoptedEffect, Diagnosis, Patched, Prediction, Trace
from twin.diagnosis.windows import WINDOW
from twin.effects import meaning
from twin.files.whole import write_file
from twin.recording import CHANNEL_UNITS
from twin.report import certainty, display, figures, pages, tables
from twin.report.figures import Figure

_MOST_NUMBERS = 350_000
"""In the figures of all recordings together, of 5.3 bytes each: pages stay below 4 MB, plotly.js included."""
_MOST_FIGURES = 24  # of held-out, and of fitted recordings
_MOST_POINTS, _FEWEST_POINTS = 2000, 200  # of a line
_NUMBERS = (
    17  # for each point of a channel: four lines, three residuals, the latter with their value in the unit
)
_FIT_SHARE = 0.5  # points of a fitted recording, over those of a held-out one


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
    return pages.render("report/report.html.j2", page=_content(diagnosis), files=files or {}, d=diagnosis)


def _content(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the template, by name."""
    held_out, fit = display.by_role(diagnosis, "holdout"), display.by_role(diagnosis, "fit")
    traces, points = list(_traces(diagnosis)), _line_points(held_out, fit)
    # The first trace stands where the page says what is missing, the others with the evidence.
    missing = traces[0] if traces and diagnosis.verdict != "no-missing-effect" else None
    return {
        "headline": display.headline(diagnosis),
        "caveat": display.caveat(diagnosis),
        "counted": display.counted(diagnosis),
        "picture": _picture(diagnosis),
        "effects": [_effect(effect) for effect in diagnosis.effects],
        "dependence": display.dependence(diagnosis),
        "trace": missing,
        "traces": traces[1:] if missing else traces,
        "all_traces": traces,
        "patch": _patch(diagnosis.patched),
        "certainty": certainty.answers(diagnosis),
        "numbers": tables.numbers(diagnosis),
        "window": f"{WINDOW:g}",
        "budget": tables.budget(diagnosis),
        "held_out_errors": tables.errors(held_out),
        "zeros": display.unknown_zeros(diagnosis),
        "worse": display.degradations(held_out),
        "unknown_noise": ", ".join(_unknown_noise(diagnosis)),
        "fit_errors": tables.errors(fit),
        "fit_large": display.large_fitted_errors(fit),
        "held_out": list(_recordings(held_out, points)),
        "not_drawn": sum(max(len(shown) - _MOST_FIGURES, 0) for shown in (held_out, fit)),
        "fit": list(_recordings(fit, max(int(_FIT_SHARE * points), _FEWEST_POINTS))),
        "not_fitted": [labels.words(name) for name in diagnosis.never_fitted],
        "alternatives": tables.alternatives(diagnosis),
        "scores": tables.scores(diagnosis),
        "calibrated": tables.calibrated(diagnosis),
        "recordings": tables.recordings(diagnosis),
    }


def _picture(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """The one picture of the page: a channel of a recording, measured, before and after; None without any."""
    found = display.telling_channel(diagnosis)
    if found is None:
        return None
    file, name = found
    prediction = diagnosis.predictions[file]
    error, shown = prediction.errors[name], labels.channel(name)
    unseen = ", which nothing was fitted to" if prediction.role == "holdout" else ", which was fitted"
    noise = f"; the sensor's own noise is {labels.amount(name, error.noise)}" if error.noise > 0 else ""
    zero = f" The zero of {labels.with_the(name)} is unknown and was taken out." * (
        name in prediction.unknown_zeros
    )
    known = math.isfinite(error.before) and math.isfinite(error.after)
    return {
        "channel": labels.sentence(shown.label),
        "before": labels.amount(name, error.before) if known else "",
        "after": labels.amount(name, error.after) if known else "",
        "caption": f"{file}{unseen}, simulated from its first sample and its command alone. "
        f"Root mean square over the whole recording{noise}.{zero}",
        "figure": figures.headline_figure(prediction, name, display.line_names(diagnosis)),
    }


def _effect(effect: AdoptedEffect) -> dict[str, Any]:
    return {
        "name": labels.sentence(labels.words(effect.name)),
        "meaning": meaning(effect.name),
        "parameters": display.parameter_rows(effect),
    }


# Unmodelled quantities


def _traces(diagnosis: Diagnosis) -> Iterator[dict[str, Any]]:
    axis = figures.JoinedTime.of(diagnosis.traces)
    for trace in diagnosis.traces:
        yield _trace(diagnosis, trace, axis)


def _trace(diagnosis: Diagnosis, trace: Trace, axis: figures.JoinedTime) -> dict[str, Any]:
    against = _explaining_variable(diagnosis, trace)
    label = labels.sentence(labels.unmodelled(trace.channel).label)
    beside = labels.variable(against).label if against else None
    model = "final" if diagnosis.effects and trace.fitted is None else "calibrated"
    most = f"; it depends most on {beside}" if beside and trace.explained_by == against else ""
    fitted = ". Blue: what the effects found explain of it" if trace.fitted is not None else ""
    return {
        "label": label,
        "title": f"{label} against {beside}" if beside else label,
        "caption": f"What the {model} model leaves unexplained, from the fit recordings{most}{fitted}.",
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
        "table": tables.patch(patched),
    }


# Recordings


def _recordings(predictions: Mapping[str, Prediction], points: int) -> Iterator[tuple[str, Figure | None]]:
    for file, prediction in [*predictions.items()][:_MOST_FIGURES]:
        yield file, figures.recording_figure(prediction, points)


def _line_points(held_out: Mapping[str, Prediction], fit: Mapping[str, Prediction]) -> int:
    """Returns how many points a line of a held-out recording keeps."""
    weighted = ((held_out, 1.0), (fit, _FIT_SHARE))
    channels = sum(
        weight * len(p.errors) for shown, weight in weighted for p in [*shown.values()][:_MOST_FIGURES]
    )
    fitting = int(_MOST_NUMBERS / (_NUMBERS * max(channels, 1)))
    return min(max(fitting, _FEWEST_POINTS), _MOST_POINTS)


def _unknown_noise(diagnosis: Diagnosis) -> list[str]:
    names = {
        labels.channel(name).label: None
        for prediction in diagnosis.predictions.values()
        for name, error in prediction.errors.items()
        if math.isnan(labels.over_noise(1.0, error.noise))
    }
    return list(names)
