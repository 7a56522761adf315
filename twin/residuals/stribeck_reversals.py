"""Sliding friction that falls with the speed, along a measured motion of the hub.

Where the hub turns round such a friction is at its peak for a few milliseconds, hardly more than a step of the grid.
The motion has passed a low-pass that rounds off just that: what friction does to the hub there, in less time than the
filter lets through, is put back as far as friction has made it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from twin.mechanics import planar
from twin.mechanics.plant import Plant
from twin.mechanics.state import Motion
from twin.residuals.cell_means import at_cells, at_instants, cell, in_cells, of_cells
from twin.residuals.filters import GRID, REACH, low_passed
from twin.residuals.view import View
from twin.rigs.model import Model

_ROUNDS, _KEPT = 8, 0.3
"""Rounds in which friction is found along with the motion that it makes, and the share of the last one in each."""
_LEAST = 1e-9  # rad/s, a change of rate that is none


def along(view: View, model: Model, motion: Motion) -> np.ndarray:
    """Torque (m) of sliding friction [N m], its mean over a grid step averaged over a step again.

    Nothing is put back where the hub may stick: what seems to begin there would turn a creeping hub round.
    """
    angle, measured = in_cells(motion.angles[:, 0]), in_cells(motion.rates[:, 0])
    resting = at_cells(motion.modes == 0)
    sure = at_cells(binary_dilation(view.sliding, iterations=round(REACH / 2 / GRID)))
    mobility = cell(view.time) / model.chain.free_hub_inertia()

    def at(rate: np.ndarray) -> np.ndarray:
        mean = _means(model.plant, (angle[1:] + angle[:-1]) / 2, rate)
        return np.where(resting[1:] | resting[:-1], 0.0, mean)

    friction, taken = at(measured), np.zeros(len(measured))
    for _ in range(_ROUNDS):
        pushed = np.r_[0.0, np.cumsum(friction)] * mobility
        passed = in_cells(low_passed(at_instants(of_cells(pushed)), GRID, view.band))
        taken = _KEPT * taken + (1 - _KEPT) * (pushed - passed)
        friction = at(measured + np.where(sure, taken, 0.0))
    before, behind = np.r_[friction[:1], friction], np.r_[friction, friction[-1:]]
    return of_cells((before + behind) / 2)


def _means(plant: Plant, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Mean friction torque [N m] between instants (c) that are close together.

    A hub that turns round slows down faster than it speeds up behind, for friction turns its sign: the instant is that
    at which the rates before it and those behind it, each as a straight line, come to rest.

    Args:
      plant: the `Plant`.
      angle: (c - 1) of the hub between the instants [rad].
      rate: (c) of the hub [rad/s].

    Returns:
      (c - 1)
    """
    mean = planar.mean_friction(plant, angle, (rate[1:] + rate[:-1]) / 2, np.diff(rate))
    turned = np.flatnonzero(rate[1:-2] * rate[2:-1] < 0) + 1
    before, behind = rate[turned], rate[turned + 1]
    slowing = np.abs(before) / np.maximum(np.abs(rate[turned - 1] - before), _LEAST)
    speeding = np.abs(behind) / np.maximum(np.abs(rate[turned + 2] - behind), _LEAST)
    share = slowing / (slowing + speeding)
    at = angle[turned]
    to_rest = planar.mean_friction(plant, at, before / 2, -before)
    from_rest = planar.mean_friction(plant, at, behind / 2, behind)
    mean[turned] = share * to_rest + (1 - share) * from_rest
    return mean
