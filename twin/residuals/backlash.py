"""What a play between motor and hub passes on, seen from a hub whose motion is measured.

The motor is followed alone, from the middle of the play. An impact is over before the filtered motion of the hub shows
any of it: what the filter has taken from the hub's acceleration is put back, and the hub gives way as its inertia
lets it,

    alpha = alpha_measured + (T - F T) / J            T: torque through the play, F: the filter, J: hub without motor

in which T is found in a few rounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from twin.mechanics.planar import backlash_torque
from twin.mechanics.plant import Plant
from twin.residuals.cell_means import CELLS, at_instants, cell, in_cells, of_cells, torque_in_cells
from twin.residuals.filters import GRID, REACH, low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import View, hub_motion
from twin.rigs.model import Model

_ROUNDS = 6
_EVERY = 0.1  # s between other first states of the motor
_FORGOTTEN = 0.5  # s after which they should not be seen
FIRMER = 1.2
"""Parts of its static friction that a rig may have."""


class _Hub(NamedTuple):
    """The hub and the drive in each cell (c): what the motor is followed by."""

    plant: Plant
    period: float
    acceleration: np.ndarray
    angle: np.ndarray
    drive: np.ndarray
    mobility: float

    def push(self, part: slice = slice(None)) -> np.ndarray:
        """Mean torque (c) on the hub in each cell of a part [N m]."""
        motion = self.acceleration[part], self.angle[part]
        start = ((part.start or 0) - CELLS) * self.period
        return backlash_torque(self.plant, self.period, *motion, self.drive[part], self.mobility, start)


def passed_on(view: View, prepared: Prepared, model: Model) -> np.ndarray:
    """Torque (m) through the play on the hub about each instant, averaged over a step twice [N m]."""
    return of_cells(_followed(view, prepared, model)[1])


def doubtful(view: View, prepared: Prepared, model: Model, noise: float, slow: float) -> np.ndarray:
    """Instants (m) at which what a play passes on is not told by the motion of the hub, with the filter's reach.

    Args:
      view: the recording.
      prepared: the same.
      model: with or without a play.
      noise: of the torque on the hub [N m].
      slow: rate of the hub that its noise may seem to be [rad/s].
    """
    if model.plant.motor.gap <= 0:
        return np.zeros(len(view.time), dtype=bool)
    hub, pushed = _followed(view, prepared, model)
    found = _unsettled(view, hub, pushed, noise) | _between_impacts(view, hub, pushed, slow)
    return binary_dilation(found, iterations=round(REACH / GRID))


def _between_impacts(view: View, hub: _Hub, pushed: np.ndarray, slow: float) -> np.ndarray:
    """Instants (m) at which friction may hold the hub between two impacts: the filter hides how slow it was."""
    taken = of_cells(pushed) - _seen(view, pushed)
    rate = in_cells(view.rate + hub.mobility * GRID * np.cumsum(taken))
    grip = FIRMER * max(hub.plant.friction.static_positive, hub.plant.friction.static_negative) * hub.mobility
    held = (np.abs(rate) < slow) & (np.abs(hub.acceleration + hub.mobility * pushed) < grip)
    return held[CELLS:-CELLS].reshape(-1, CELLS).any(axis=1) & (view.direction != 0)


def _unsettled(view: View, hub: _Hub, pushed: np.ndarray, noise: float) -> np.ndarray:
    """Instants (m) at which what a play passes on hangs on how the motor moved half a second before.

    A motor that rattles fast has several ways to do so, and jumps from one to another: that tells more of its past than
    of the play. Begun anew time and again in the middle of the play, it should soon do what it did anyway.
    """
    found = np.zeros(len(view.time), dtype=bool)
    half = round(_FORGOTTEN / GRID)
    for first in range(0, len(view.time) - half, round(_EVERY / GRID)):
        part = slice(CELLS * (first + 1), CELLS * min(first + 1 + 2 * half, len(view.time) + 1))
        off = low_passed((hub.push(part) - pushed[part]).reshape(-1, CELLS).mean(axis=1)[half:], GRID)
        found[first + half : first + 2 * half] |= np.abs(off) > noise
    return found


def _followed(view: View, prepared: Prepared, model: Model) -> tuple[_Hub, np.ndarray]:
    """The hub as it moves when it is pushed, and the mean torque (c) that pushes it in each cell [N m]."""
    motion, plant = hub_motion(view, model), model.plant
    measured = in_cells(motion.acceleration)
    drive = torque_in_cells(model, prepared.recording, view.time)
    hub = _Hub(plant, cell(view.time), measured, in_cells(motion.angle), drive, 0.0)
    pushed = hub.push()
    mobility = 1 / (plant.hub_inertia - plant.motor.inertia)
    for _ in range(_ROUNDS):
        slow = in_cells(_seen(view, pushed))
        hub = hub._replace(acceleration=measured - mobility * slow, mobility=mobility)
        pushed = hub.push()
    return hub, pushed


def _seen(view: View, pushed: np.ndarray) -> np.ndarray:
    """What the filter of the motion leaves of a torque (c), at the instants of the grid (m) [N m]."""
    return low_passed(at_instants(of_cells(pushed)), GRID, view.band)
