"""Effects of a model on the sensors, applied sample by sample: delay, gain, nonlinearity, drift."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from twin.control.plants.base import READINGS, Plant
from twin.effects import REGISTRY, TORSION, Effect
from twin.recording import LONGEST_DELAY
from twin.rigs.model import Model

_MORE = 4  # samples kept beyond it, for the interpolation between samples


class SensorEffects:
    """The effects of a model on its sensors. Before the first sample, the rig is taken to have rested in that state."""

    def __init__(self, model: Model, plant: Plant) -> None:
        """Takes the model with its effects, and the plant that is measured."""
        self._model, self._plant = model, plant
        changed = any(type(REGISTRY[name]).sensing is not Effect.sensing for name in model.effects)
        self._changes = changed or (model.patch is not None and model.patch.on_sensor)
        self._past: deque[tuple[float, ...]] = deque(maxlen=math.ceil(LONGEST_DELAY / plant.period) + _MORE)

    def reset(self) -> None:
        """Discards all past readings."""
        self._past.clear()

    def read(self, time: float, true: Mapping[str, float]) -> Mapping[str, float]:
        """Returns the readings at `time` [s] of true values by channel, SI."""
        if not self._changes:
            return true
        self._past.append((time, *(true[name] for name in READINGS), self._plant.twist))
        times, *values = np.array(self._past).T
        reported = self._model.report(times, dict(zip((*READINGS, TORSION), values, strict=True)))
        return {name: float(reported[name][-1]) for name in READINGS}
