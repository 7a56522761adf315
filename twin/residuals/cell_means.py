"""Double means over a step of the uniform grid, in which torques of the hub are compared.

A drive holds its torque between two updates, and the mean of such a torque over a grid step h is (omega h)^2/24 too
small against the torque that a motion requires at an instant, at 18 Hz and h = 2 ms by 0.2 %. So both torques are
averaged over a step twice before they are compared.

Steps are divided into `CELLS` cells. Arrays on the grid have m elements, arrays of cells c = (m + 2) CELLS: the middle
of cell k lies k/CELLS - 1 steps behind the first instant.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from twin.effects.base import Drive
from twin.residuals.filters import SPLINE_DEGREE

CELLS = 9
"""Cells of a grid step, an odd number, so that a cell is centred on each instant."""


def double_mean_torque(drive: Drive, time: np.ndarray) -> np.ndarray:
    """Double mean (m) of the torque that the drive delivers, about each instant of a uniform grid (m) [N m]."""
    return double_mean_of_cells(mean_torque_in_cells(drive, time))


def cell_length(time: np.ndarray) -> float:
    """Length of a cell of a uniform grid (m) [s]."""
    return float(time[1] - time[0]) / CELLS


def interpolated_in_cells(values: np.ndarray) -> np.ndarray:
    """A smooth signal on the grid (m), interpolated to the middle of each cell (c) by Lagrange polynomials.

    They have the degree of the spline through the samples.
    """
    taps = SPLINE_DEGREE + 1
    extended = np.pad(values, (taps // 2, taps // 2 + 1), "edge")
    return (sliding_window_view(extended, taps) @ _interpolation_weights()).ravel()


def nearest_in_cells(values: np.ndarray) -> np.ndarray:
    """In each cell (c) the value (m) at the nearest instant of the grid."""
    extended = np.pad(values, 1, "edge")
    first = CELLS // 2
    return np.pad(np.repeat(extended, CELLS)[first:], (0, first), "edge")


@functools.cache
def _interpolation_weights() -> np.ndarray:
    """Lagrange weights (taps x cells) of the instants around a step for the middles of its cells."""
    taps, x = np.arange(SPLINE_DEGREE + 1), SPLINE_DEGREE // 2 + np.arange(CELLS) / CELLS
    others = [np.delete(taps, k) for k in taps]
    return np.array(
        [np.prod((x - o[:, None]) / (k - o[:, None]), axis=0) for k, o in zip(taps, others, strict=True)]
    )


def mean_torque_in_cells(drive: Drive, time: np.ndarray) -> np.ndarray:
    """Mean torque (c) that the drive delivers in each cell of a uniform grid (m) [N m]."""
    edges = np.arange(-CELLS, (len(time) + 1) * CELLS + 1) - 0.5
    return np.diff(drive.impulse(time[0] + edges * cell_length(time))) / cell_length(time)


def double_mean_of_cells(values: np.ndarray) -> np.ndarray:
    """Double mean (m) about the instants of the grid of means over its cells (c).

    A held command is a staircase. Its mean over one step is still too small by (omega h)^2/24, its double mean is not,
    and it keeps the instant of a short pulse.
    """
    window = np.convolve(np.ones(CELLS), np.ones(CELLS)) / CELLS**2
    return sliding_window_view(values, len(window))[1 : 1 - CELLS : CELLS] @ window


def double_mean(values: np.ndarray) -> np.ndarray:
    """Double mean (m) of a smooth signal on the grid (m), x + h^2 x''/12; the two ends are left as they are."""
    means = values.copy()
    means[1:-1] += (values[:-2] - 2 * values[1:-1] + values[2:]) / 12
    return means


def from_double_mean(means: np.ndarray) -> np.ndarray:
    """A smooth signal on the grid (m) from its double mean (m), to second order in the step."""
    return 2 * means - double_mean(means)


def mean_direction(rate: np.ndarray, acceleration: np.ndarray, step: float) -> np.ndarray:
    """Mean of the sign of the hub's rate over a step about each instant (m), relative to the sign at the instant.

    It is 1 except where the hub reverses within the step.

    Args:
      rate: of the hub (m) [rad/s].
      acceleration: of the hub (m) [rad/s^2].
      step: of the grid [s].
    """
    return np.clip(np.abs(rate) / np.maximum(np.abs(acceleration) * step / 2, 1e-12), 0.0, 1.0)
