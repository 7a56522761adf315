"""Initial state of a simulation, the measured rests that guide it, and the motion that it returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Motion:
    """State of the chain over time; n hinges, m instants.

    Attributes:
      time: (m) [s].
      angles: (m, n + 1) absolute angles of the segments [rad].
      rates: (m, n + 1) their rates [rad/s].
      modes: (m) 0 where the hub sticks, +1 or -1 the direction in which it slides.
      extra, extra_rates: (m, k) absolute angles and rates of the coordinates that effects append: of a torsional mode,
        of a motor with backlash.
    """

    time: np.ndarray
    angles: np.ndarray
    rates: np.ndarray
    modes: np.ndarray
    extra: np.ndarray
    extra_rates: np.ndarray

    @staticmethod
    def from_coordinates(
        time: np.ndarray, angles: np.ndarray, rates: np.ndarray, modes: np.ndarray, links: int
    ) -> Motion:
        """Returns a motion from coordinates of a plant (m, n + 1 + k); the first `links` = n + 1 are segments."""
        return Motion(time, angles[:, :links], rates[:, :links], modes, angles[:, links:], rates[:, links:])

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles and rates of all coordinates of the plant, (m, n + 1 + k) each."""
        return np.hstack([self.angles, self.extra]), np.hstack([self.rates, self.extra_rates])


@dataclass(frozen=True)
class Start:
    """State at the first sample.

    Attributes:
      hub_angle, hub_rate: of the hub [rad], [rad/s].
      bend, bend_rate: (2) tip deflection by each of the first two clamped modes [m], and its rate [m/s].
    """

    hub_angle: float = 0.0
    hub_rate: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)
    bend_rate: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Guide:
    """Measured rests and directions of motion of the hub, imposed on a simulation: see `planar.simulate`.

    Attributes:
      observed: (m) int64, `planar.STUCK`, +1, -1 or `planar.UNDECIDED` at each sample.
      anchor: (m) measured hub angle while the hub rests [rad].
    """

    observed: np.ndarray
    anchor: np.ndarray
