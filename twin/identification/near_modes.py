"""Which resonances lie where a rig has a bending mode with its hub free."""

from __future__ import annotations

import numpy as np

from twin.mechanics import beam
from twin.parameters import Rig

MODES = 4
SOFTER, STIFFER = 0.2, 0.08
"""Relative distance of a resonance from a mode up to which it is that mode: large bends soften it."""


def bending_frequencies(rig: Rig, count: int = MODES) -> np.ndarray:
    """Frequencies (count) of the bending modes with a free hub [Hz]."""
    return beam.modes(rig, count).frequencies / (2 * np.pi)


def near_bending(frequency: float, rig: Rig) -> bool:
    """Whether a resonance [Hz] lies near a bending mode of the rig."""
    off = frequency / bending_frequencies(rig) - 1
    return bool(((off > -SOFTER) & (off < STIFFER)).any())
