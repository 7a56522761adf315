"""Bending modes of a rig with a free hub, and which resonances lie at one of them."""

from __future__ import annotations

import numpy as np

from twin.mechanics import beam
from twin.parameters import Rig

MODES = 4
"""Modes that a resonance is compared with: on the rig of Bossi et al. four reach beyond the band of the spectra."""
SOFTENING_TOLERANCE, STIFFENING_TOLERANCE = 0.2, 0.08
"""Relative distance of a resonance below and above a mode within which it is that mode; large bends soften it."""


def bending_frequencies(rig: Rig, count: int = MODES) -> np.ndarray:
    """Returns the frequencies (count) of the first bending modes with a free hub [Hz]."""
    return beam.modes(rig, count).frequencies / (2 * np.pi)


def is_near_bending_mode(frequency: float, rig: Rig) -> bool:
    """Whether a resonance [Hz] lies within the tolerances of a bending mode of the rig."""
    off = frequency / bending_frequencies(rig) - 1
    return bool(((off > -SOFTENING_TOLERANCE) & (off < STIFFENING_TOLERANCE)).any())
