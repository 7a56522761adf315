"""What a controller acts on: a rig that moves for one sample period under a held torque."""

from __future__ import annotations

from typing import Protocol

import numpy as np

READINGS = ("hub_angle", "tip_deflection", "strain_base", "strain_mid", "motor_torque")
"""True values that every plant can be asked for, by channel of the recording format."""

PERIOD = 2e-3
"""Sample period of the card [s], assumed: Bossi et al. 2009 name the card, not its rate."""


class Plant(Protocol):
    """A simulated rig between two samples of a controller; it keeps its own state.

    What is behind it, modes or a chain, cannot be told from outside but by how it moves.

    Attributes:
      name: for people: "chain", "modal".
      period: sample period [s].
      torque_limit: of the amplifier [N m]; may be infinite.
    """

    name: str
    period: float
    torque_limit: float

    def reset(self, hub_angle: float = 0.0) -> None:
        """Puts the rig to rest at a hub angle [rad], the link as it hangs there, at time 0."""

    def advance(self, torque: float) -> None:
        """Moves on by one period under a commanded torque [N m]; the amplifier limits it."""

    def time(self) -> float:
        """Time since the reset [s]."""

    def read(self) -> dict[str, float]:
        """True value of each channel in `READINGS` now, SI."""

    @property
    def mode(self) -> int:
        """0 while the hub sticks, else the direction +1 or -1 in which it slides."""

    @property
    def twist(self) -> float:
        """Angle of a torsional mode against the hub [rad]; 0 where there is none."""

    @property
    def configuration(self) -> np.ndarray:
        """Coordinates (c) from which `outline` draws the link now."""

    def outline(self, configurations: np.ndarray) -> np.ndarray:
        """Centre line of the link in the plane (m, k, 2) [m], hub axis first, tip last.

        Args:
          configurations: (m, c), each as `configuration` gave it.
        """
