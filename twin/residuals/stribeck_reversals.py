"""Sliding friction that falls with the speed (Stribeck), along a measured motion of the hub.

Where the hub reverses, such a friction peaks for a few milliseconds, hardly more than a step of the grid. The filter of
the measured motion rounds off the change of rate that the peak causes. It is put back by fixed-point iteration:
friction gives the motion that the filter removes, and the motion gives the friction.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from twin.mechanics import planar
from twin.mechanics.plant import Plant
from twin.mechanics.state import Motion
from twin.residuals.cell_means import (
    cell_length,
    double_mean_of_cells,
    from_double_mean,
    interpolated_in_cells,
    nearest_in_cells,
)
from twin.residuals.filters import GRID, REACH, low_passed
from twin.residuals.numerics import FIXED_POINT_STEPS
from twin.residuals.view import Signals
from twin.rigs.model import Model

_KEPT = 0.3  # share of the last result that an iteration keeps


def friction_torque(signals: Signals, model: Model, motion: Motion) -> np.ndarray:
    """Double mean (m) of the torque of sliding friction, see `cell_means` [N m].

    Nothing is put back where the hub may stick: it would reverse a hub that creeps.
    """
    angle = interpolated_in_cells(motion.angles[:, 0])
    measured = interpolated_in_cells(motion.rates[:, 0])
    resting = nearest_in_cells(motion.modes == 0)
    slides = nearest_in_cells(binary_dilation(signals.sliding, iterations=round(REACH / 2 / GRID)))
    mobility = cell_length(signals.time) / model.chain.free_hub_inertia()

    def friction_at(rate: np.ndarray) -> np.ndarray:
        mean = _mean_friction(model.plant, (angle[1:] + angle[:-1]) / 2, rate)
        return np.where(resting[1:] | resting[:-1], 0.0, mean)

    friction, removed = friction_at(measured), np.zeros(len(measured))
    for _ in range(FIXED_POINT_STEPS):
        change = np.r_[0.0, np.cumsum(friction)] * mobility
        passed = interpolated_in_cells(
            low_passed(from_double_mean(double_mean_of_cells(change)), GRID, signals.band)
        )
        removed = _KEPT * removed + (1 - _KEPT) * (change - passed)
        friction = friction_at(measured + np.where(slides, removed, 0.0))
    before, behind = np.r_[friction[:1], friction], np.r_[friction, friction[-1:]]
    return double_mean_of_cells((before + behind) / 2)


def _mean_friction(plant: Plant, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Mean friction torque between adjacent instants (c - 1) [N m].

    A hub that reverses slows down faster than it speeds up afterwards, because friction changes its sign. The instant
    of the reversal is where straight lines through the rates before it and behind it come to zero.

    Args:
      plant: equations of motion, of which the friction is used.
      angle: of the hub between the instants (c - 1) [rad].
      rate: of the hub at the instants (c) [rad/s].
    """
    mean = planar.mean_friction(plant, angle, (rate[1:] + rate[:-1]) / 2, np.diff(rate))
    turned = np.flatnonzero(rate[1:-2] * rate[2:-1] < 0) + 1
    before, behind = rate[turned], rate[turned + 1]
    # Times to and from the reversal, |rate| / |acceleration|, both times the product of the accelerations.
    slowing = np.abs(before * (rate[turned + 2] - behind))
    speeding = np.abs(behind * (rate[turned - 1] - before))
    share = slowing / np.maximum(slowing + speeding, np.finfo(float).tiny)
    at = angle[turned]
    to_rest = planar.mean_friction(plant, at, before / 2, -before)
    from_rest = planar.mean_friction(plant, at, behind / 2, behind)
    mean[turned] = share * to_rest + (1 - share) * from_rest
    return mean
