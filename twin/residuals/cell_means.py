"""Means over a step of the uniform grid, on which the motion of the hub is compared with a torque.

A drive holds its torque between two updates. Averaged over a grid step it is (omega h)^2/24 too small beside the torque
that a motion takes at an instant, at 18 Hz and h = 2 ms by 0.2 %. So both are averaged, twice.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from twin.recording import Recording
from twin.rigs.model import Model

CELLS = 9
"""Parts of a grid step, an odd number."""
_TAPS = 8  # instants between which a signal is interpolated


def mean_torque(model: Model, recording: Recording, time: np.ndarray) -> np.ndarray:
    """Torque (m) of the drive about each instant of a uniform grid, averaged over a step twice [N m]."""
    return of_cells(torque_in_cells(model, recording, time))


def cell(time: np.ndarray) -> float:
    """Length of a cell of a uniform grid (m) [s]."""
    return float(time[1] - time[0]) / CELLS


def in_cells(values: np.ndarray) -> np.ndarray:
    """A smooth signal in the middle of each such cell (c), from its instants on the grid (m).

    By the polynomial through the instants beside it (J. L. Lagrange).
    """
    extended = np.pad(values, (_TAPS // 2, _TAPS // 2 + 1), "edge")
    return (sliding_window_view(extended, _TAPS) @ _between()).ravel()


def at_cells(values: np.ndarray) -> np.ndarray:
    """What holds at the nearest instant of the grid (m), in each such cell (c)."""
    extended = np.pad(values, 1, "edge")
    first = CELLS // 2
    return np.pad(np.repeat(extended, CELLS)[first:], (0, first), "edge")


@functools.cache
def _between() -> np.ndarray:
    """Weights (taps x cells) of the instants about a step for a signal at its cells."""
    taps, x = np.arange(_TAPS), _TAPS // 2 - 1 + np.arange(CELLS) / CELLS
    others = [np.delete(taps, k) for k in taps]
    return np.array(
        [np.prod((x - o[:, None]) / (k - o[:, None]), axis=0) for k, o in zip(taps, others, strict=True)]
    )


def torque_in_cells(model: Model, recording: Recording, time: np.ndarray) -> np.ndarray:
    """Mean torque (c) of the drive in each cell of a uniform grid (m), from a step before it to one behind it [N m]."""
    edges = np.arange(-CELLS, (len(time) + 1) * CELLS + 1) - 0.5
    return np.diff(model.drive(recording).impulse(time[0] + edges * cell(time))) / cell(time)


def of_cells(values: np.ndarray) -> np.ndarray:
    """Means over a step (m) about the instants of a grid, averaged over a step again, of means over its cells (c).

    A command that is held makes a staircase. Its mean over one step still sees the stairs (by (omega h)^2/24), the
    mean of that mean no longer: it keeps the instant at which a short push acts.
    """
    window = np.convolve(np.ones(CELLS), np.ones(CELLS)) / CELLS**2
    return np.convolve(values, window, "same")[CELLS:-CELLS:CELLS]


def twice_averaged(values: np.ndarray) -> np.ndarray:
    """Means over a grid step of means over a grid step (m) of a smooth signal: x + h^2 x''/12; the ends as they are."""
    means = values.copy()
    means[1:-1] += (values[:-2] - 2 * values[1:-1] + values[2:]) / 12
    return means


def at_instants(means: np.ndarray) -> np.ndarray:
    """What a smooth signal is at the instants of a grid (m), from its means over a step, averaged over a step again."""
    return 2 * means - twice_averaged(means)


def one_way(rate: np.ndarray, acceleration: np.ndarray, step: float) -> np.ndarray:
    """Mean of the hub's direction over a grid step about each instant (m), over the direction there.

    It is 1 but where the hub turns round within the step.

    Args:
      rate: (m) of the hub [rad/s].
      acceleration: (m) of the hub [rad/s^2].
      step: of the grid [s].
    """
    return np.clip(np.abs(rate) / np.maximum(np.abs(acceleration) * step / 2, 1e-12), 0.0, 1.0)
