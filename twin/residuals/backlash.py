"""Torque through a backlash on a hub whose motion is measured.

The motor is simulated alone, from the middle of the backlash, against the measured motion of the hub. An impact is
shorter than the filter of that motion, which removes it from the hub's acceleration. It is put back, and the hub moves
under the impact as its inertia allows:

    alpha = alpha_measured + (T - F T) / J        T: torque through the backlash, F: the filter, J: hub without motor

T is found by fixed-point iteration.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from twin.effects.base import Drive
from twin.mechanics.planar import backlash_steps, backlash_torque
from twin.mechanics.plant import Plant
from twin.residuals.cell_means import (
    CELLS,
    cell_length,
    double_mean_of_cells,
    from_double_mean,
    interpolated_in_cells,
    mean_torque_in_cells,
)
from twin.residuals.filters import GRID, REACH, low_passed
from twin.residuals.numerics import FIXED_POINT_STEPS
from twin.residuals.prepared import Prepared
from twin.residuals.view import SETTLING, Signals, hub_trajectory
from twin.rigs.model import Model

_RESTART_INTERVAL = 0.1  # s between the instants at which the motor is simulated anew
STATIC_MARGIN = 1.2
"""Largest ratio of a rig's static friction to the model's that is reckoned with."""


class _Hub(NamedTuple):
    """Inputs of the simulated motor in each cell (c).

    Attributes:
      plant: the model's equations of motion.
      period: length of a cell [s].
      acceleration: of the hub without what the low-passed torque through the backlash does (c) [rad/s^2].
      angle: of the hub (c) [rad].
      drive: torque of the motor (c) [N m].
      mobility: reciprocal inertia with which the hub gives way to an impact [1/(kg m^2)].
    """

    plant: Plant
    period: float
    acceleration: np.ndarray
    angle: np.ndarray
    drive: np.ndarray
    mobility: float

    def transmitted(self, part: slice = slice(None)) -> np.ndarray:
        """Mean torque through the backlash in each cell of a part (c) [N m], from the middle of the backlash."""
        motion = self.acceleration[part], self.angle[part]
        start = ((part.start or 0) - CELLS) * self.period
        return backlash_torque(self.plant, self.period, *motion, self.drive[part], self.mobility, start)


def transmitted_torque(signals: Signals, prepared: Prepared, model: Model) -> np.ndarray:
    """Double mean (m) of the torque through the backlash on the hub, see `cell_means` [N m]."""
    return double_mean_of_cells(_solve(signals, prepared, model)[1])


def inputs(signals: Signals, drive: Drive, model: Model) -> tuple[float | np.ndarray, ...]:
    """What the torque through the backlash depends on; most declared parameters of the link are not among it."""
    plant, hub = model.plant, hub_trajectory(signals, model)
    steps = backlash_steps(plant, cell_length(signals.time))
    motor: tuple[Any, ...] = (*plant.motor._replace(contact_step=0.0), steps, plant.hub_inertia)
    friction: tuple[Any, ...] = plant.friction if plant.friction.on_motor else ()
    laws: tuple[Any, ...] = plant.torques if plant.torques.on_motor.any() else ()
    return (*motor, *friction, *laws, hub.angle, hub.acceleration, *drive.inputs)


def undetermined(signals: Signals, prepared: Prepared, model: Model, noise: float, slow: float) -> np.ndarray:
    """Instants (m) at which the motion of the hub does not determine the torque through a backlash.

    The reach of the filter is added on either side. Without a backlash there are none.

    Args:
      signals: the recording on the grid.
      prepared: the recording.
      model: with or without a backlash.
      noise: standard deviation of the torque on the hub [N m].
      slow: rate of the hub that its noise can pretend [rad/s].
    """
    if model.plant.motor.gap <= 0:
        return np.zeros(len(signals.time), dtype=bool)
    hub, torque = _solve(signals, prepared, model)
    unknown = _depends_on_past(signals, hub, torque, noise) | _may_stick(signals, hub, torque, slow)
    return binary_dilation(unknown, iterations=round(REACH / GRID))


def _may_stick(signals: Signals, hub: _Hub, torque: np.ndarray, slow: float) -> np.ndarray:
    """Instants (m) at which friction may hold the hub between two impacts: the filter hides how slow the hub was."""
    if hub.plant.rubs_on_motor:
        return np.zeros(len(signals.time), dtype=bool)
    removed = double_mean_of_cells(torque) - _low_passed_torque(signals, torque)
    rate = interpolated_in_cells(signals.rate + hub.mobility * GRID * np.cumsum(removed))
    friction = hub.plant.friction
    holdable = STATIC_MARGIN * max(friction.static_positive, friction.static_negative) * hub.mobility
    held = (np.abs(rate) < slow) & (np.abs(hub.acceleration + hub.mobility * torque) < holdable)
    return held[CELLS:-CELLS].reshape(-1, CELLS).any(axis=1) & (signals.direction != 0)


def _depends_on_past(signals: Signals, hub: _Hub, torque: np.ndarray, noise: float) -> np.ndarray:
    """Instants (m) at which the torque through the backlash depends on the motor's state half a second before.

    A motor that rattles fast has several periodic motions and jumps from one to another; which one it is in says more
    about its past than about the backlash. Simulated anew from the middle of the backlash, it should do the same after
    `view.SETTLING`, to within the noise.
    """
    differs = np.zeros(len(signals.time), dtype=bool)
    half = round(SETTLING / GRID)
    for first in range(0, len(signals.time) - half, round(_RESTART_INTERVAL / GRID)):
        part = slice(CELLS * (first + 1), CELLS * min(first + 1 + 2 * half, len(signals.time) + 1))
        change = hub.transmitted(part) - torque[part]
        change = low_passed(change.reshape(-1, CELLS).mean(axis=1)[half:], GRID)
        differs[first + half : first + 2 * half] |= np.abs(change) > noise
    return differs


def _solve(signals: Signals, prepared: Prepared, model: Model) -> tuple[_Hub, np.ndarray]:
    """Fixed-point iteration of the equation above: the hub, and the mean torque (c) on it in each cell [N m]."""
    motion, plant = hub_trajectory(signals, model), model.plant
    measured = interpolated_in_cells(motion.acceleration)
    drive = mean_torque_in_cells(model.drive(prepared.recording), signals.time)
    hub = _Hub(plant, cell_length(signals.time), measured, interpolated_in_cells(motion.angle), drive, 0.0)
    torque = hub.transmitted()
    mobility = 1 / (plant.hub_inertia - plant.motor.inertia)
    for _ in range(FIXED_POINT_STEPS):
        slow = interpolated_in_cells(_low_passed_torque(signals, torque))
        hub = hub._replace(acceleration=measured - mobility * slow, mobility=mobility)
        torque = hub.transmitted()
    return hub, torque


def _low_passed_torque(signals: Signals, torque: np.ndarray) -> np.ndarray:
    """The part of a torque in cells (c) that the filter of the hub's motion passes, on the grid (m) [N m]."""
    return low_passed(from_double_mean(double_mean_of_cells(torque)), GRID, signals.band)
