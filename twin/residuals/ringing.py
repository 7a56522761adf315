"""Ringing of the modelled link under noise of the hub angle, and whitening of residuals against it.

A link driven by the measured hub angle is driven by its noise, too. Each piece of noise excites the clamped modes, and
a lightly damped one rings for seconds: the modelled strains and the torque that the modelled motion requires oscillate
at its frequency, coherently over many stretches of time, unlike white noise. An effect must not be found in it.

The covariance of this oscillation follows from the mode and the noise, and a residual is whitened by the inverse root
of it. The oscillation spans few directions only, so that gaps in the residual (a hub at rest) do not matter.

Where readings of the hub are missing, its motion is interpolated. What it did beside that also makes the link ring on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.rigs.model import Model

MIN_DECAY_TIME = 1.0
"""Time constant 1/(zeta omega) of the decay from which a mode is treated here, and not by a stationary filter [s]."""
_KICK_INTERVAL = 0.5  # s of noise that is represented by one impulse
_MAX_KICKS = 100  # impulses in a recording
_DETUNING = np.linspace(-0.05, 0.05, 5)
"""Deviations of a mode's frequency where the link bends far [1]: with a bend of 0.5 rad, that of the second is -4 %."""
_MIN_VARIANCE = 0.05  # of a direction relative to the other noise, from which it is whitened


@dataclass(frozen=True, eq=False)
class RingingMode:
    """A clamped mode that rings under noise of the hub angle.

    Attributes:
      shape: angles of the segments per unit of the modal coordinate (n).
      pull: torque on the hub per unit of the modal coordinate [N m].
      coordinate: modal coordinate over time after each of k impulses of one standard deviation (m x k).
    """

    shape: np.ndarray
    pull: float
    coordinate: np.ndarray


def ringing_modes(
    model: Model,
    time: np.ndarray,
    shaken: np.ndarray,
    density: float,
    band: float,
    unknown: Sequence[tuple[float, float]] = (),
) -> list[RingingMode]:
    """The lightly damped clamped modes under noise of the hub angle, and all under what it did unseen.

    A clamped mode q'' + 2 z w q' + w^2 q = -p a responds to the acceleration a of the hub and puts the torque -p w^2 q
    on it. Noise of the angle of spectral density S is noise of the acceleration of density w^4 S near the mode.

    Args:
      model: its link.
      time: instants (m) [s].
      shaken: whether the link follows the noise (m); a resting hub is held still.
      density: two-sided spectral density of the noise of the hub angle [rad^2 s].
      band: highest frequency of a mode [Hz].
      unknown: first instants of spans without a reading of the hub [s], and standard deviations of the change of rate
        that it may have had in each [rad/s].
    """
    omega, shapes = model.chain.modes("clamped")
    ratios = model.chain.damping_ratios("clamped")
    participations = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    interval = max(_KICK_INTERVAL, float(time[-1] - time[0]) / _MAX_KICKS)
    kicked = np.arange(time[0], time[-1], interval)
    shares = np.array([piece.mean() for piece in np.split(shaken, np.searchsorted(time, kicked[1:]))])
    later = time[:, None] - kicked[shares > 0]
    # Noise within an interval excites the oscillation at a random phase: sine and cosine have half the variance each.
    kick = np.tile(np.sqrt(density * interval / 2 * shares[shares > 0]), 2)
    after = time[:, None] - np.array([begin for begin, _ in unknown])
    change = np.tile([rate for _, rate in unknown], 2)
    modes = []
    for w, z, p, shape in zip(omega, ratios, participations, shapes.T, strict=True):
        if w >= 2 * np.pi * band:
            continue
        unseen = np.hstack([p / w * change * _oscillations(w * (1 + d), z, after) for d in _DETUNING])
        rings = z * w * MIN_DECAY_TIME < 1
        shaking = p * w * kick * _oscillations(w, z, later) if rings else unseen[:, :0]
        if rings or len(unknown):
            modes.append(RingingMode(shape, -p * w**2, np.hstack([shaking, unseen])))
    return modes


def _oscillations(w: float, z: float, later: np.ndarray) -> np.ndarray:
    """Decaying sines and cosines (m x 2k) at times after each kick (m x k); w [rad/s], damping ratio z."""
    decay = np.where(later > 0, np.exp(-z * w * np.maximum(later, 0.0)), 0.0)
    return np.hstack([decay * np.sin(w * later), decay * np.cos(w * later)])


@dataclass(frozen=True, eq=False)
class Ringing:
    """Directions of a residual in which it has more noise than in the others.

    Attributes:
      directions: orthonormal (m x k).
      shares: part of the component in each direction that `whitened` subtracts (k).
    """

    directions: np.ndarray
    shares: np.ndarray

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """The residual (..., m) with the same noise in every direction."""
        return residual - (residual @ self.directions * self.shares) @ self.directions.T


def from_columns(columns: np.ndarray) -> Ringing:
    """The ringing whose covariance is the sum of the squares of columns (m x k), in units of the other noise."""
    variance, axes = np.linalg.eigh(columns.T @ columns)
    kept = variance > _MIN_VARIANCE
    return Ringing(columns @ axes[:, kept] / np.sqrt(variance[kept]), 1 - 1 / np.sqrt(1 + variance[kept]))
