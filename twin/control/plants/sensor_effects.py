"""What the sensors of a model make of true values, sample by sample: late, with another gain, bent or drifting."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from twin.control.plants.base import READINGS, Plant
from twin.effects import REGISTRY, TORSION, Effect
from twin.rigs.model import Model

_LONGEST_DELAY = 0.05  # s, bound of the effect `sensor-delay`
_MORE = 4  # samples beyond it, for the spline between samples


class SensorEffects:
    """The effects of a model on its sensors; before the first sample the rig rested as it did then."""

    def __init__(self, model: Model, plant: Plant) -> None:
        """Takes the model with its effects, and the plant that is read."""
        self._model, self._plant = model, plant
        bent = any(type(REGISTRY[name]).sensing is not Effect.sensing for name in model.effects)
        self._changes = bent or (model.patch is not None and model.patch.on_sensor)
        self._past: deque[tuple[float, ...]] = deque(maxlen=math.ceil(_LONGEST_DELAY / plant.period) + _MORE)

    def reset(self) -> None:
        """Forgets all readings."""
        self._past.clear()

    def read(self, time: float, true: Mapping[str, float]) -> Mapping[str, float]:
        """Returns what is reported at `time` [s] of true values by channel, SI."""
        if not self._changes:
            return true
        self._past.append((time, *(true[name] for name in READINGS), self._plant.twist))
        times, *values = np.array(self._past).T
        said = self._model.report(times, dict(zip((*READINGS, TORSION), values, strict=True)))
        return {name: float(said[name][-1]) for name in READINGS}
