"""A controller that reads what the sensors of a rig report: late, with another gain, bent or drifting."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from twin.control.base import Controller
from twin.effects import REGISTRY, TORSION, Effect
from twin.model import Model
from twin.plants.base import READINGS
from twin.plants.chain import CompiledPlant

_LONGEST_DELAY = 0.05  # s, bound of the effect `sensor-delay`
_MORE = 4  # samples beyond it, for the spline between samples


def reported(law: Controller, model: Model, plant: CompiledPlant) -> Controller:
    """Returns the controller behind the sensors of a model; itself where its effects change no sensor."""
    changed = any(type(REGISTRY[name]).sensing is not Effect.sensing for name in model.effects)
    return Reported(law, model, plant) if changed else law


class Reported:
    """A controller behind sensors that effects act on; before the first sample the rig rested as it did then."""

    def __init__(self, law: Controller, model: Model, plant: CompiledPlant) -> None:
        """Takes the controller, the model with its effects, and the plant that it acts on."""
        self._law, self._model, self._plant = law, model, plant
        self._links = len(model.chain.lengths)
        self._past: deque[tuple[float, ...]] = deque(maxlen=math.ceil(_LONGEST_DELAY / plant.period) + _MORE)

    def reset(self) -> None:
        """Forgets all readings."""
        self._law.reset()
        self._past.clear()

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`."""
        self._past.append((measured["time"], *(measured[name] for name in READINGS), self._twist()))
        time, *values = np.array(self._past).T
        said = self._model.report(time, dict(zip((*READINGS, TORSION), values, strict=True)))
        return self._law.torque({**measured, **{name: float(said[name][-1]) for name in READINGS}}, reference)

    def _twist(self) -> float:
        """Angle of a torsional mode against the hub [rad]."""
        if self._model.plant.torsion_stiffness <= 0:
            return 0.0
        angles = self._plant.configuration
        return float(angles[self._links] - angles[0])
