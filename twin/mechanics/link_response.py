"""Linear response of the link to forces while the hub moves as prescribed."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter, ss2tf

from twin.mechanics.chain import Chain


def modal_coordinates(
    chain: Chain, forces: np.ndarray, period: float, accelerations: bool = False
) -> np.ndarray:
    """Coordinates eta (n, ..., m) of the link's modes with the hub clamped, unit modal mass, zero at first.

    eta'' + 2 zeta omega eta' + omega^2 eta = force on the mode, which is linear between samples (Meirovitch,
    Fundamentals of Vibrations, 2001, ch. 7). Neglected are large angles, and coupling of the modes by damping.

    Args:
      chain: the link; its clamped modes have the hinge angles `chain.modes("clamped")[1][1:]`.
      forces: on each mode (n, ..., m): hinge angles of the mode times moments on the hinges.
      period: of the samples [s].
      accelerations: whether eta'' is returned instead.
    """
    frequencies, _ = chain.modes("clamped")
    coordinates = np.zeros(forces.shape)
    for k, (omega, zeta) in enumerate(zip(frequencies, chain.damping_ratios("clamped"), strict=True)):
        system = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
        by_force = np.array([[0.0], [1.0]])
        output = system[1:] if accelerations else np.array([[1.0, 0.0]])
        direct = np.array([[1.0 if accelerations else 0.0]])
        discrete = cont2discrete((system, by_force, output, direct), period, "foh")
        numerator, denominator = ss2tf(*discrete[:4])
        coordinates[k] = lfilter(numerator[0], denominator, forces[k])
    return coordinates
