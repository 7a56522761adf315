"""Held-out recordings that contradict a model which explains the fit recordings.

They choose nothing, and can only withdraw a verdict. Windows are compared, each of which begins anew: a stick or slip
more than measured changes one of them, a wrong model most. A window begins with the measured state, whose error can be
large in a fast motion: a model that predicts the free run of the whole recording is not contradicted by windows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from twin.diagnosis.answer import Contradiction, Prediction
from twin.diagnosis.error_budget import ModelError
from twin.diagnosis.rules import MODEL_SHARE
from twin.recording import HUB_TORQUE
from twin.residuals.significance import FOLLOWS


def contradictions(
    predictions: Mapping[str, Prediction], has_effects: bool, in_one: Collection[str] = ()
) -> tuple[Contradiction, ...]:
    """The contradictions in held-out recordings, the largest over its limit first.

    Where a model is right, its errors in held-out windows are as those in fitted ones. Of the median window and of the
    whole run, less what a right effect may leave (`MODEL_SHARE`), both are larger than `FOLLOWS` times the noise,
    and than `FOLLOWS` times the median window of the worst fit recording, where that is explained itself, or
    than the errors of the calibrated model. A channel that one fit recording alone leaves unexplained may be the fault
    of that recording: it is not where a held-out one is not followed either.

    Args:
      predictions: file -> prediction.
      has_effects: whether the final model has effects that the calibrated one lacks.
      in_one: channels that one fit recording alone leaves unexplained.
    """
    alone = {"hub_angle" if channel == HUB_TORQUE else channel for channel in in_one}
    found = []
    for file, prediction in predictions.items():
        if prediction.role != "holdout":
            continue
        for channel, budget in prediction.budget.items():
            noise, size = budget.noise, _excess(budget.after, budget.before)
            fitted = max(_fitted(predictions, channel), default=noise)
            limits = {}
            if fitted < FOLLOWS * noise:
                limits["fit"] = FOLLOWS * max(noise, fitted)
            elif channel in alone:
                limits["one"] = FOLLOWS * noise
            if has_effects:
                limits["calibrated"] = max(FOLLOWS * noise, _size(budget.calibrated))
            reference, limit = min(limits.items(), key=lambda pair: pair[1], default=("", np.inf))
            if noise > 0 and np.isfinite(limit) and size > limit:
                found.append(Contradiction(file, channel, size / noise, limit / noise, reference))
    return tuple(sorted(found, key=lambda c: -c.size / c.limit))


def in_words(found: Contradiction, label: str) -> str:
    """A sentence on a contradiction; `label`: the channel in words."""
    than = {
        "fit": f"but {found.limit / FOLLOWS:.2g} at most in the fit recordings",
        "calibrated": f"but {found.limit:.2g} without the effects",
        "one": "and one of the fit recordings is not explained either",
    }
    return (
        f"The held-out {found.recording} contradicts the model: in every second window or more {label} is off by "
        f"{found.size:.3g} noise levels, {than[found.reference]}."
    )


def _fitted(predictions: Mapping[str, Prediction], channel: str) -> list[float]:
    """Median window of the final model in each fit recording that has the channel, SI."""
    sizes = [
        _median(p.windows[channel]) for p in predictions.values() if p.role == "fit" and channel in p.windows
    ]
    return [size for size in sizes if np.isfinite(size)]


def _excess(after: ModelError, before: ModelError) -> float:
    """Size of an error [SI] less the share of the error of the declared model that a right effect may leave."""
    return float(np.sqrt(max(_size(after) ** 2 - (MODEL_SHARE * _size(before)) ** 2, 0.0)))


def _size(error: ModelError) -> float:
    """The smaller of the median window and the whole run, root mean square, SI; NaN without windows."""
    return float(np.minimum(_median(error), error.rms))


def _median(error: ModelError) -> float:
    """Median over the windows of the root-mean-square error, SI; NaN without windows."""
    known = [size for size in error.by_window if np.isfinite(size)]
    return float(np.median(known)) if known else float("nan")
