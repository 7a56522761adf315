"""What the noise of the hub angle does to a residual by way of a link that rings.

A link that follows the measured hub follows its noise too. Each bit of it kicks the clamped modes, and one that is
lightly damped rings on for seconds: modelled strains and the torque that the modelled motion takes then swing at that
mode's frequency, in step over many stretches, which no white noise does. Such a swing is not to be taken for an effect.
Its covariance follows from the mode and the noise, and a residual is made white by the inverse root of it. The swing
covers a few directions only, so that gaps in the residual (a hub that rests) are no obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.rigs.model import Model

LIGHT = 1.0
"""Time that a mode has to ring for its kicks to be followed one by one [s]."""
_KICKS = 0.5  # s between the instants at which the kicks of noise are gathered
_MOST = 100  # such instants
_SEEN = 0.05  # variance of a direction of the swing, in that of the other noise, from which it is taken out


@dataclass(frozen=True, eq=False)
class Swing:
    """How a clamped mode rings under noise of the hub angle.

    Attributes:
      shape: (n) angles of the chain's segments per unit of the modal coordinate.
      pull: torque on the hub per unit of the modal coordinate [N m].
      coordinate: (m x k) modal coordinate over time after each kick, one standard deviation large.
    """

    shape: np.ndarray
    pull: float
    coordinate: np.ndarray


def swings(model: Model, time: np.ndarray, shaken: np.ndarray, density: float, band: float) -> list[Swing]:
    """The lightly damped clamped modes under noise of the hub angle.

    A clamped mode q'' + 2 z w q' + w^2 q = -p a moves under the acceleration a of the hub and puts the torque -p w^2 q
    on it; noise of the angle of density S makes an acceleration of density w^4 S near the mode's frequency.

    Args:
      model: its link.
      time: (m) instants [s].
      shaken: (m) whether the link follows noise: a resting hub is held still.
      density: two-sided spectral density of the noise of the hub angle [rad^2 s].
      band: modes above it are not followed [Hz].
    """
    omega, shapes = model.chain.modes("clamped")
    ratios = model.chain.damping_ratios("clamped")
    pushes = model.chain.mass_matrix()[0, 1:] @ shapes[1:]
    apart = max(_KICKS, float(time[-1] - time[0]) / _MOST)
    kicked = np.arange(time[0], time[-1], apart)
    shares = np.array([piece.mean() for piece in np.split(shaken, np.searchsorted(time, kicked[1:]))])
    later = time[:, None] - kicked[shares > 0]
    kick = np.tile(np.sqrt(density * apart / 2 * shares[shares > 0]), 2)
    found = []
    for w, z, p, shape in zip(omega, ratios, pushes, shapes.T, strict=True):
        if w < 2 * np.pi * band and z * w * LIGHT < 1:
            decay = np.where(later > 0, np.exp(-z * w * np.maximum(later, 0.0)), 0.0)
            waves = np.hstack([decay * np.sin(w * later), decay * np.cos(w * later)])
            found.append(Swing(shape, -p * w**2, p * w * kick * waves))
    return found


@dataclass(frozen=True, eq=False)
class Ringing:
    """Directions in which a residual swings by itself.

    Attributes:
      directions: (m x k) orthonormal.
      shares: (k) of each that `whitened` takes out.
    """

    directions: np.ndarray
    shares: np.ndarray

    def whitened(self, residual: np.ndarray) -> np.ndarray:
        """The residual (..., m) with the noise in every direction as large as in those without a swing."""
        return residual - (residual @ self.directions * self.shares) @ self.directions.T


def of_columns(swing: np.ndarray) -> Ringing:
    """The directions of swings (m x k), each one standard deviation large, in units of the other noise."""
    variance, axes = np.linalg.eigh(swing.T @ swing)
    seen = variance > _SEEN
    return Ringing(swing @ axes[:, seen] / np.sqrt(variance[seen]), 1 - 1 / np.sqrt(1 + variance[seen]))
