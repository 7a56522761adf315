"""What moves: the state at the first sample, the guide of a run, and the motion that comes of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Motion:
    """State of the chain over time; n hinges, m instants.

    Attributes:
      time: (m) [s].
      angles: (m, n + 1) absolute angles of the segments [rad].
      rates: (m, n + 1) [rad/s].
      modes: (m) 0 where the hub sticks, +1 or -1 where it slides.
      extra, extra_rates: (m, k) of coordinates that effects add: absolute angles of a torsional mode, of a motor
        with play.
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
        """Splits the coordinates of a plant (m, n + 1 + k) into those of the link (n + 1) and the others."""
        return Motion(time, angles[:, :links], rates[:, :links], modes, angles[:, links:], rates[:, links:])

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles and rates of all coordinates (m, n + 1 + k), as the plant has them."""
        return np.hstack([self.angles, self.extra]), np.hstack([self.rates, self.extra_rates])


@dataclass(frozen=True)
class Start:
    """State at the first sample.

    Attributes:
      hub_angle, hub_rate: of the hub [rad], [rad/s].
      bend, bend_rate: amplitude of the first two clamped modes (2) and its rate, as tip deflection [m], [m/s].
    """

    hub_angle: float = 0.0
    hub_rate: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)
    bend_rate: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Guide:
    """What the measured hub angle says of sticking and sliding: see `planar.simulate`.

    Attributes:
      observed: (m) int64 flags.
      anchor: (m) measured angle while the hub rests [rad].
    """

    observed: np.ndarray
    anchor: np.ndarray
