"""Error budget of a recording: what each step of a diagnosis takes away of the error of each channel.

Steps are the declared model, the calibrated one, one more effect each in the order of adoption, and the final model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from twin.diagnosis.windows import WINDOW, Windowed
from twin.recording import CHANNEL_UNITS, Recording
from twin.residuals.prepared import Prepared
from twin.residuals.residual import has_unknown_zero
from twin.rigs.model import Model


@dataclass(frozen=True)
class ModelError:
    """Error of one model in one channel of a recording, measured minus simulated, SI.

    Attributes:
      rms: root mean square of the free run of the whole recording.
      rms_window: the same in windows of `windows.WINDOW`, each of which begins anew, see `windows.simulate_windows`;
        NaN without windows.
      fit_percent: 100 (1 - |error|/|measured - its mean|) of the free run; NaN where the reading is constant.
      fit_percent_window: the same in the windows.
      by_window: root mean square of each window, in their order; NaN for one that was left out.
    """

    rms: float
    rms_window: float = math.nan
    fit_percent: float = math.nan
    fit_percent_window: float = math.nan
    by_window: tuple[float, ...] = field(default=(), repr=False)

    def to_json(self) -> dict[str, float | None]:
        """The error as plain values; None for what does not exist, or is not finite."""
        values = {name: getattr(self, name) for name in _FIELDS}
        return {name: value if math.isfinite(value) else None for name, value in values.items()}


_FIELDS = ("rms", "rms_window", "fit_percent", "fit_percent_window")


@dataclass(frozen=True)
class ChannelBudget:
    """Errors of one channel of a recording along the steps of a diagnosis, SI.

    Attributes:
      unit: SI unit of the channel.
      noise: standard deviation of the sensor noise.
      before, calibrated: of the declared and the calibrated model.
      steps: (effect, error of the calibrated model with it and those before it), in the order of adoption.
      after: of the final model; that of the last step, or `calibrated`.
    """

    unit: str
    noise: float
    before: ModelError
    calibrated: ModelError
    steps: tuple[tuple[str, ModelError], ...]
    after: ModelError

    @property
    def models(self) -> tuple[ModelError, ...]:
        """Errors of the declared model, the calibrated one, and after each effect."""
        return (self.before, self.calibrated, *(error for _, error in self.steps))

    def to_json(self) -> dict[str, Any]:
        """The budget as plain values."""
        return {
            "unit": self.unit,
            "noise": self.noise,
            "window_s": WINDOW,
            "before": self.before.to_json(),
            "calibrated": self.calibrated.to_json(),
            "steps": [{"effect": name, **error.to_json()} for name, error in self.steps],
            "after": self.after.to_json(),
        }


def channel_budgets(
    prepared: Prepared, effects: Sequence[str], errors: Sequence[Mapping[str, ModelError]]
) -> dict[str, ChannelBudget]:
    """Channel -> its budget.

    Args:
      prepared: the recording.
      effects: in the order of adoption.
      errors: channel -> error, of the declared model, of the calibrated one, and after each effect.
    """
    before, calibrated, *steps = errors
    return {
        c: ChannelBudget(
            unit=CHANNEL_UNITS[c],
            noise=prepared.noise[c],
            before=before[c],
            calibrated=calibrated[c],
            steps=tuple((name, step[c]) for name, step in zip(effects, steps, strict=True)),
            after=errors[-1][c],
        )
        for c in prepared.channels
    }


def model_errors(
    prepared: Prepared, model: Model, free: Recording, windows: Windowed | None
) -> dict[str, ModelError]:
    """Channel -> error of a model, from its free run and its simulation in windows, see `windows.simulate_windows`."""
    return {c: _error(prepared, model, c, free, windows) for c in prepared.channels}


def rms_error(off: np.ndarray, has_zero: bool) -> float:
    """Root mean square of a difference (m), NaN left out, about the zero of its sensor: the mean, if it is unknown."""
    return float(np.sqrt(np.nanmean(_about_zero(off, has_zero) ** 2)))


def _about_zero(off: np.ndarray, has_zero: bool) -> np.ndarray:
    return off - zero_of(off) if has_zero else off


def zero_of(off: np.ndarray) -> float:
    """Zero of a sensor from measured minus simulated (m): the mean, NaN left out; 0 without samples."""
    return float(np.nanmean(off)) if np.isfinite(off).any() else 0.0


def _error(
    prepared: Prepared, model: Model, channel: str, free: Recording, windows: Windowed | None
) -> ModelError:
    measured = prepared.recording[channel]
    has_zero = has_unknown_zero(model, prepared, channel)
    known = np.isfinite(measured)
    rms, fit = _rms_and_fit(measured[known], free[channel][known], has_zero)
    if windows is None:
        return ModelError(rms, fit_percent=fit)
    known &= windows.inside
    rms_window, fit_window = _rms_and_fit(measured[known], windows.readings[channel][known], has_zero)
    squares = _about_zero((measured - windows.readings[channel])[known], has_zero) ** 2
    return ModelError(rms, rms_window, fit, fit_window, _by_group(squares, windows.window[known]))


def _rms_and_fit(measured: np.ndarray, simulated: np.ndarray, has_zero: bool) -> tuple[float, float]:
    """Root mean square [SI] and fit [per cent] of a simulation (m); NaN without samples."""
    if not len(measured):
        return math.nan, math.nan
    rms = rms_error(measured - simulated, has_zero)
    moved = float(np.std(measured))
    return rms, 100 * (1 - rms / moved) if moved > 0 else math.nan


def _by_group(squares: np.ndarray, group: np.ndarray) -> tuple[float, ...]:
    """Root mean square of each group (g) of squares (m); NaN for one without samples."""
    count = np.bincount(group)
    return tuple(np.sqrt(np.bincount(group, squares) / np.where(count > 0, count, np.nan)).tolist())
