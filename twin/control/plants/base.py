"""The interface of a plant: a simulated rig that is advanced by one sample period under a held torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from twin.errors import checked_number

READINGS = ("hub_angle", "tip_deflection", "strain_base", "strain_mid", "motor_torque")
"""Channels of the recording format whose true values every plant provides."""

Reference = Callable[[float], float]
"""Reference of the hub angle [rad] as a function of time [s]."""

_LARGEST_REFERENCE = 1e6
"""Largest reference of the hub angle [rad]: beyond it, a double has no more digits than an angle sensor."""


def wanted_angle(reference: Reference, time: float) -> float:
    """Returns the reference [rad] at a time [s]; raises InputError where it is no number, or beyond any rig."""
    return checked_number(
        f"the reference at {time:g} s", reference(time), -_LARGEST_REFERENCE, _LARGEST_REFERENCE, "rad"
    )


PERIOD = 2e-3
"""Sample period of the card [s], assumed: Bossi et al. 2009 name the card but not its sampling rate."""


class Plant(Protocol):
    """A simulated rig with its own state.

    The interface is the same for modes and chain, so that a controller cannot distinguish them but by their motion.

    Attributes:
      name: for people: "chain", "modal", ...
      period: sample period [s].
      torque_limit: of the amplifier [N m]; may be infinite.
    """

    name: str
    period: float
    torque_limit: float

    def reset(self, hub_angle: float = 0.0) -> None:
        """Resets to time 0, at rest at a hub angle [rad], the link in static equilibrium with gravity in the plane."""

    def advance(self, torque: float) -> None:
        """Advances by one period under a commanded torque [N m], which the amplifier limits."""

    def time(self) -> float:
        """Time since the reset [s]."""

    def read(self) -> dict[str, float]:
        """Returns the present true value of each channel in `READINGS`, SI."""

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction +1 or -1 in which it slides."""

    @property
    def twist(self) -> float:
        """Angle of a torsional mode relative to the hub [rad]; 0 without one."""

    @property
    def configuration(self) -> np.ndarray:
        """Present coordinates (c), from which `outline` draws the link."""

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """Returns the centre line of the link in the plane (m, k, 2) [m], hub axis first, tip last.

        Args:
          configurations: (m, c), each a value of `configuration`.
        """
