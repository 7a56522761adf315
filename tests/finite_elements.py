"""The link as Hermite beam elements: an independent model to hold the exact modes against.

Element matrices: M. Petyt, "Introduction to Finite Element Vibration Analysis". Degrees of freedom:
deflection and slope of every node in the frame fixed in space, less the deflection of the hub; so the first
is the hub angle, the last two are the tip's deflection and slope.
"""

import numpy as np
from scipy.linalg import eigh


class FiniteElementLink:
    """Mass and stiffness of the link with its hub and payload, small angles."""

    def __init__(self, rig, elements=60):
        self.length = rig["length"]
        h = self.length / elements
        self.nodes = np.linspace(0, self.length, elements + 1)
        m = (rig["linear_density"] * h / 420) * np.array(
            [
                [156, 22 * h, 54, -13 * h],
                [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                [54, 13 * h, 156, -22 * h],
                [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
            ]
        )
        k = (rig["bending_stiffness"] / h**3) * np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h**2, -6 * h, 4 * h**2],
            ]
        )
        mass, stiffness = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
        for e in range(elements):
            part = slice(2 * e, 2 * e + 4)
            mass[part, part] += m
            stiffness[part, part] += k
        mass[1, 1] += rig["hub_inertia"]
        mass[-2, -2] += rig["tip_mass"]
        mass[-1, -1] += rig["tip_inertia"]
        self.mass, self.stiffness = mass[1:, 1:], stiffness[1:, 1:]

    def modes(self, n, boundary="free"):
        """Frequencies (n) [rad/s] and vectors (dof x n) of unit modal mass; the rigid rotation left out."""
        locked = int(boundary == "clamped")
        rigid = 1 - locked
        K, M = self.stiffness[locked:, locked:], self.mass[locked:, locked:]
        # A shift makes the stiffness of the free rig definite and is taken away again.
        shift = 1.0
        vectors = eigh(K + shift * M, M, subset_by_index=(rigid, n + rigid - 1))[1]
        # An inverse iteration takes out the rounding of the stiffest modes, 1e8 times as stiff as the first.
        closer = np.linalg.solve(K + shift * M, M @ vectors)
        squared = np.einsum("ki,kl,li->i", closer, K, closer) / np.einsum("ki,kl,li->i", closer, M, closer)
        return np.sqrt(squared), np.vstack([np.zeros((locked, n)), vectors])

    def deflections(self, vectors):
        """Deflection at the nodes (n x nodes)."""
        return np.vstack([np.zeros(vectors.shape[1]), vectors[1::2]]).T

    def response(self, omega):
        """Complex amplitudes (dof) per torque on the hub at `omega` [rad/s], undamped."""
        torque = np.zeros(len(self.mass))
        torque[0] = 1.0
        return np.linalg.solve(self.stiffness - omega**2 * self.mass, torque)
