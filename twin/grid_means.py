"""Means over a step of the uniform grid, on which the motion of the hub is compared with a torque.

A drive holds its torque between two updates. Averaged over a grid step it is (omega h)^2/24 too small beside the torque
that a motion takes at an instant, at 18 Hz and h = 2 ms by 0.2 %. So both are averaged, twice.
"""

from __future__ import annotations

import numpy as np

from twin.model import Model
from twin.recording import Recording

_CELLS = 9  # parts of a grid step, an odd number


def mean_torque(model: Model, recording: Recording, time: np.ndarray) -> np.ndarray:
    """Torque (m) of the drive about each instant of a uniform grid, averaged over a step twice [N m].

    A command that is held makes a staircase. Its mean over one step still sees the stairs (by (omega h)^2/24), the
    mean of that mean no longer.
    """
    cell = float(time[1] - time[0]) / _CELLS
    edges = np.arange(-_CELLS, (len(time) + 1) * _CELLS + 1)
    mean = np.diff(model.drive(recording).impulse(time[0] + (edges - 0.5) * cell)) / cell
    window = np.convolve(np.ones(_CELLS), np.ones(_CELLS)) / _CELLS**2
    return np.convolve(mean, window, "same")[_CELLS::_CELLS][: len(time)]


def twice_averaged(values: np.ndarray) -> np.ndarray:
    """Means over a grid step of means over a grid step (m) of a smooth signal: x + h^2 x''/12; the ends as they are."""
    means = values.copy()
    means[1:-1] += (values[:-2] - 2 * values[1:-1] + values[2:]) / 12
    return means


def one_way(rate: np.ndarray, acceleration: np.ndarray, step: float) -> np.ndarray:
    """Mean of the hub's direction over a grid step about each instant (m), over the direction there.

    It is 1 but where the hub turns round within the step.

    Args:
      rate: (m) of the hub [rad/s].
      acceleration: (m) of the hub [rad/s^2].
      step: of the grid [s].
    """
    return np.clip(np.abs(rate) / np.maximum(np.abs(acceleration) * step / 2, 1e-12), 0.0, 1.0)
