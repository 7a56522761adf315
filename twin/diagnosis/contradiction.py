"""Held-out recordings that contradict a model which explains the fit recordings.

They choose nothing, and can only withdraw a verdict. Windows are compared, each of which begins anew: a stick or slip
more than measured changes one of them, a wrong model most.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.diagnosis.answer import Contradiction, Prediction
from twin.diagnosis.error_budget import ModelError
from twin.diagnosis.rules import WORST_RESIDUAL


def contradictions(predictions: Mapping[str, Prediction], has_effects: bool) -> tuple[Contradiction, ...]:
    """The contradictions in held-out recordings, the largest over its limit first.

    Where a model is right, its errors in held-out windows are as those in fitted ones. The median window is off by more
    than `WORST_RESIDUAL` times the noise and the median window of the worst fit recording, or by more than that of the
    calibrated model and `WORST_RESIDUAL` times the noise.

    Args:
      predictions: file -> prediction.
      has_effects: whether the final model has effects that the calibrated one lacks.
    """
    found = []
    for file, prediction in predictions.items():
        if prediction.role != "holdout":
            continue
        for channel, budget in prediction.budget.items():
            noise, size = budget.noise, _median(budget.after)
            fitted = max(_fitted(predictions, channel), default=noise)
            limits = {"fit": WORST_RESIDUAL * max(noise, fitted)}
            if has_effects:
                limits["calibrated"] = max(WORST_RESIDUAL * noise, _median(budget.calibrated))
            reference = min(limits, key=lambda name: limits[name])
            limit = limits[reference]
            if noise > 0 and np.isfinite(limit) and size > limit:
                found.append(Contradiction(file, channel, size / noise, limit / noise, reference))
    return tuple(sorted(found, key=lambda c: -c.size / c.limit))


def in_words(found: Contradiction, label: str) -> str:
    """A sentence on a contradiction; `label`: the channel in words."""
    than = (
        f"{found.limit / WORST_RESIDUAL:.2g} at most in the fit recordings"
        if found.reference == "fit"
        else f"{found.limit:.2g} without the effects"
    )
    return (
        f"The held-out {found.recording} contradicts the model: in every second window or more {label} is off by "
        f"{found.size:.3g} noise levels, but {than}."
    )


def _fitted(predictions: Mapping[str, Prediction], channel: str) -> list[float]:
    """Median window of the final model in each fit recording that has the channel, SI."""
    sizes = [
        _median(p.windows[channel]) for p in predictions.values() if p.role == "fit" and channel in p.windows
    ]
    return [size for size in sizes if np.isfinite(size)]


def _median(error: ModelError) -> float:
    """Median over the windows of the root-mean-square error, SI; NaN without windows."""
    known = [size for size in error.by_window if np.isfinite(size)]
    return float(np.median(known)) if known else float("nan")
