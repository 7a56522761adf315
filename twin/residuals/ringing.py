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
"""Time constant 1/(zeta omega) of the decay from which a mode of the strains is treated here, and not by a stationary
filter [s]. The torque on the hub, unknown where it rests, has no such filter: all its modes are treated here."""
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
      damping_ratio: of the mode.
      begin: instant of each impulse (k) [s].
      size: of the modal coordinate after an impulse of one standard deviation (k).
      frequency: angular frequency after each impulse (k) [rad/s].
    """

    shape: np.ndarray
    pull: float
    damping_ratio: float
    begin: np.ndarray
    size: np.ndarray
    frequency: np.ndarray

    def coordinate(self, time: np.ndarray, impulses: slice = slice(None)) -> np.ndarray:
        """The modal coordinate at instants (m) after some impulses: decaying sines, then cosines (m x 2k)."""
        w = self.frequency[impulses]
        later = time[:, None] - self.begin[impulses]
        size = np.where(later > 0, self.size[impulses], 0.0)
        size *= np.exp(-self.damping_ratio * w * np.maximum(later, 0.0))
        return np.hstack([size * np.sin(w * later), size * np.cos(w * later)])


def ringing_modes(
    model: Model,
    time: np.ndarray,
    shaken: np.ndarray,
    density: float,
    band: float,
    unknown: Sequence[tuple[float, float]] = (),
    decay_time: float = 0.0,
) -> list[RingingMode]:
    """The clamped modes under noise of the hub angle, and under what it did unseen.

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
      decay_time: time constant of the decay from which a mode rings under the noise [s].
    """
    omega, shapes = model.chain.modes("clamped")
    ratios = model.chain.damping_ratios("clamped")
    participations = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    interval = max(_KICK_INTERVAL, float(time[-1] - time[0]) / _MAX_KICKS)
    kicked = np.arange(time[0], time[-1], interval)
    shares = np.array([piece.mean() for piece in np.split(shaken, np.searchsorted(time, kicked[1:]))])
    # Noise within an interval excites the oscillation at a random phase: sine and cosine have half the variance each.
    kick = np.sqrt(density * interval / 2 * shares[shares > 0])
    gaps, change = np.array(unknown).reshape(-1, 2).T
    modes = []
    for w, z, p, shape in zip(omega, ratios, participations, shapes.T, strict=True):
        if w >= 2 * np.pi * band:
            continue
        impulses = [(gaps, p / w * change, np.full(len(gaps), w * (1 + d))) for d in _DETUNING]
        if z * w * decay_time < 1:
            impulses.append((kicked[shares > 0], p * w * kick, np.full(len(kick), w)))
        begin, size, frequency = (np.concatenate(part) for part in zip(*impulses, strict=True))
        if len(begin):
            modes.append(RingingMode(shape, -p * w**2, z, begin, size, frequency))
    return modes


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
    directions = columns @ axes[:, kept]
    directions /= np.sqrt(variance[kept])
    return Ringing(directions, 1 - 1 / np.sqrt(1 + variance[kept]))
