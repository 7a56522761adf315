"""What a missing effect is: parameters with a neutral value, and where it acts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from twin.parameters import Rig
from twin.planar import Plant


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes:
      name: as in the vocabulary.
      unit: SI unit.
      neutral: value at which the effect vanishes; None where that is the declared value of a rig parameter.
      bounds: range in which it is searched for.
      step: a small but visible size, from which a search starts.
      channel: channel without which the parameter means nothing, or None.
    """

    name: str
    unit: str
    neutral: float | None
    bounds: tuple[float, float]
    step: float
    channel: str | None = None


@dataclass(frozen=True)
class Drive:
    """Torque that the drive delivers: held values behind a first-order lag.

    Attributes:
      time: (k) instants [s] from which each value is held; before the first, the torque is `before`.
      torque: (k) [N m].
      before: torque before the first instant [N m].
      lag: time constant with which the torque follows [s].
    """

    time: np.ndarray
    torque: np.ndarray
    before: float = 0.0
    lag: float = 0.0

    def replace(self, **changes) -> Drive:
        """Returns a drive with some attributes changed."""
        return replace(self, **changes)

    def at(self, t: np.ndarray) -> np.ndarray:
        """Torque at the instants t (m,), without the lag [N m]."""
        index = np.searchsorted(self.time, t + 1e-9, side="right") - 1
        return np.where(index < 0, self.before, self.torque[np.maximum(index, 0)])


class Effect:
    """A physical effect that the model may lack. Every hook is the identity unless a subclass says otherwise.

    Class attributes:
      name: as in the vocabulary.
      parameters: the `EffectParameter`s.
      along: parameters that say where or how the effect acts and mean nothing at neutral (a phase, a rest angle):
        a start gives them as they are, it does not scale them.
      replaces: declared parameters that the effect takes over: they no longer count as calibration.
    """

    name: str
    parameters: tuple[EffectParameter, ...]
    replaces: tuple[str, ...] = ()
    along: tuple[str, ...] = ()

    @property
    def joint(self) -> bool:
        """Whether the parameters make no sense one by one."""
        return bool(self.along)

    def neutral(self, rig: Mapping[str, float]) -> dict[str, float]:
        """Values at which the model is exactly the one without this effect."""
        return {p.name: rig[p.name] if p.neutral is None else p.neutral for p in self.parameters}

    def starts(self, rig: Mapping[str, float]) -> tuple[dict[str, float], ...]:
        """Values close to neutral from which a search can leave it: one per direction that it should try."""
        neutral = self.neutral(rig)
        return ({p.name: neutral[p.name] + p.step for p in self.parameters},)

    def rig(self, rig: Rig, p: Mapping[str, float]) -> Rig:
        """Changes parameters of the rig itself."""
        return rig

    def plant(self, plant: Plant, p: Mapping[str, float]) -> Plant:
        """Switches on a mechanism of the equations of motion."""
        return plant

    def drive(self, drive: Drive, p: Mapping[str, float]) -> Drive:
        """Turns commanded torque (after saturation) into delivered torque."""
        return drive

    def sensing(
        self, time: np.ndarray, channels: dict[str, np.ndarray], p: Mapping[str, float]
    ) -> dict[str, np.ndarray]:
        """Turns true channel values (name -> (m,), SI) into what the sensors report."""
        return channels
