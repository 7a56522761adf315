"""The paper's compensator for one measurement, the hub angle."""

from __future__ import annotations

import math
from collections.abc import Mapping

from twin.control.laws.base import LinearController


def siso(rig: Mapping[str, float], period: float) -> LinearController:
    """R(s) = 5 (s + 1)/((s + 5)(s + 300)) N m per degree of error: Bossi et al. 2009, section V.

    The paper does not give the unit of the error: with radians the rig would not move at all, with degrees the
    amplitudes of its Figs. 5 and 6 are reproduced. Discretised by Tustin's rule, which keeps both poles stable and has
    a gain error of 0.1 % at 10 Hz. R has no integrator, so that it needs no anti-windup.

    Args:
      rig: not used; part of the interface of every design function.
      period: sample period [s].
    """
    import control

    s = control.tf("s")
    system = control.ss(5 * (s + 1) / ((s + 5) * (s + 300)))
    return LinearController(control.sample_system(system, period, "bilinear"), 180 / math.pi)
