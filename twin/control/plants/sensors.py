"""Sensors between a plant and its controller: effects, noise from a seed, quantisation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from twin.control.plants.sensor_effects import SensorEffects


@dataclass(frozen=True)
class Instrument:
    """One sensor.

    Attributes:
      noise: standard deviation, SI.
      resolution: quantisation step of the reading, SI; 0 for none.
    """

    noise: float = 0.0
    resolution: float = 0.0


BOSSI2009: Mapping[str, Instrument] = MappingProxyType(
    {
        "hub_angle": Instrument(3e-4, 2 * math.pi / 2**16),
        "strain_base": Instrument(2e-6, 4e-3 / 2**16),
        "strain_mid": Instrument(2e-6, 4e-3 / 2**16),
        "tip_deflection": Instrument(2e-4, 0.4 / 2**16),
        "motor_torque": Instrument(1e-3, 0.6 / 2**16),
    }
)
"""Sensors of the rig. The paper names a 16-bit card; the ranges (one turn, +-2000 um/m, +-0.2 m, +-0.3 N m) and the
noise are assumed."""


@dataclass
class Sensors:
    """Readings of true values; by default equal to them.

    Attributes:
      instruments: channel -> sensor; channels without one have neither noise nor quantisation.
      seed: of the noise; readings are reproducible.
      effects: effects of a model on the sensors, applied before noise and quantisation; None for none.
    """

    instruments: Mapping[str, Instrument] = field(default_factory=dict)
    seed: int = 0
    effects: SensorEffects | None = None

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Restarts the noise from its seed, and resets the effects."""
        self._random = np.random.default_rng(self.seed)
        if self.effects is not None:
            self.effects.reset()

    def read(self, time: float, true: Mapping[str, float]) -> dict[str, float]:
        """Returns the readings at `time` [s] of true values by channel, SI."""
        if self.effects is not None:
            true = self.effects.read(time, true)
        return {channel: self._read(channel, value) for channel, value in true.items()}

    def _read(self, channel: str, value: float) -> float:
        instrument = self.instruments.get(channel)
        if instrument is None:
            return value
        value += instrument.noise * self._random.standard_normal()
        step = instrument.resolution
        return step * round(value / step) if step > 0 else value
