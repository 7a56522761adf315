"""Bang-bang torques and where the hub comes to rest behind them: Bossi et al. 2009, section VI-A.

Designed on the rig without friction, whose centre of mass turns by J alpha_tt = tau whatever the link does:

    +u for `half`, nothing for `pause`, -u for `half`:   angle = u half (half + pause) / J
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin.mechanics.beam import rigid_inertia
from twin.mechanics.state import Start
from twin.recording import Recording
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

DURATION = 4.0
"""Length of a run [s]: the hub has stuck by then."""
_LAST = 0.5  # s over which the angle of rest is taken


@dataclass(frozen=True)
class Profile:
    """A bang-bang torque.

    Attributes:
      torque: amplitude u [N m].
      half: length of either pulse [s].
      pause: between them [s].
    """

    torque: float
    half: float
    pause: float = 0.0

    def recording(self, duration: float = DURATION) -> Recording:
        """The command as a recording whose hub angle is still to be simulated; longer than `duration` if it must."""
        on, off = [0.0, self.half + self.pause], [self.half, 2 * self.half + self.pause]
        end = max(duration, off[1] + 2 * _LAST)
        torque_from = {on[0]: self.torque, off[0]: 0.0, on[1]: -self.torque, off[1]: 0.0}
        rest = np.linspace(end - _LAST, end, 6)
        time = np.r_[list(torque_from), rest]
        command = np.r_[list(torque_from.values()), np.zeros_like(rest)]
        return Recording(
            "bang-bang", time, {"torque_command": command, "hub_angle": np.full(len(time), np.nan)}
        )


def designed(rig: Mapping[str, float], angle: float, torque: float, pause: float = 0.0) -> Profile:
    """Returns the profile of amplitude `torque` [N m] that turns the rig without friction by `angle` [rad]."""
    squared = angle * rigid_inertia(rig) / torque
    return Profile(torque, math.sqrt(squared + pause**2 / 4) - pause / 2, pause)


@dataclass(frozen=True)
class Family:
    """One way to choose the profiles of a series of angles: u = torque (angle / largest)^growth.

    Attributes:
      torque: amplitude for the largest angle [N m].
      growth: 0 where all have one amplitude; 1 where all take the same time, unless there is a pause.
      pause: between the pulses [s].
    """

    torque: float
    growth: float = 0.0
    pause: float = 0.0

    def profiles(self, rig: Mapping[str, float], angles: Sequence[float]) -> tuple[Profile, ...]:
        """Returns the profile of each angle [rad]."""
        largest = max(angles)
        return tuple(
            designed(rig, angle, self.torque * (angle / largest) ** self.growth, self.pause)
            for angle in angles
        )


def turn(model: Model, profile: Profile) -> float:
    """Returns by how much the hub's sensor has turned when the rig, at rest at first, is at rest again [rad].

    The mean over the last half second, should it still move.
    """
    reading = simulate(model, profile.recording(), Start())["hub_angle"]
    return float(reading[4:].mean() - reading[0])
