"""Bang-bang torques and the angle at which the hub comes to rest: Bossi et al. 2009, section VI-A.

They are designed on the rig without friction, whose mean angle obeys J alpha_tt = tau for any motion of the link:

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
"""Length of a run [s], after which the hub sticks."""
_LAST = 0.5  # s at the end of a run over which the angle of rest is averaged


@dataclass(frozen=True)
class Profile:
    """A bang-bang torque.

    Attributes:
      torque: amplitude u [N m].
      half: duration of each pulse [s].
      pause: between the pulses [s].
    """

    torque: float
    half: float
    pause: float = 0.0

    def recording(self, duration: float = DURATION) -> Recording:
        """Returns the command as a recording without hub angles, of `duration` [s] or longer if the torque needs it."""
        on, off = [0.0, self.half + self.pause], [self.half, 2 * self.half + self.pause]
        end = max(duration, off[1] + 2 * _LAST)
        torque_from = {on[0]: self.torque, off[0]: 0.0, on[1]: -self.torque, off[1]: 0.0}
        rest = np.linspace(end - _LAST, end, 6)
        time = np.r_[list(torque_from), rest]
        command = np.r_[list(torque_from.values()), np.zeros_like(rest)]
        return Recording(
            "bang-bang", time, {"torque_command": command, "hub_angle": np.full(len(time), np.nan)}
        )


def designed_profile(rig: Mapping[str, float], angle: float, torque: float, pause: float = 0.0) -> Profile:
    """Returns the profile of amplitude `torque` [N m] that turns the rig without friction by `angle` [rad]."""
    squared = angle * rigid_inertia(rig) / torque
    return Profile(torque, math.sqrt(squared + pause**2 / 4) - pause / 2, pause)


@dataclass(frozen=True)
class Family:
    """Family of profiles for a series of angles, with amplitudes u = torque (angle / largest)^growth.

    Attributes:
      torque: amplitude for the largest angle [N m].
      growth: 0 for equal amplitudes; 1 for equal durations, without a pause [1].
      pause: between the pulses [s].
    """

    torque: float
    growth: float = 0.0
    pause: float = 0.0

    def profiles(self, rig: Mapping[str, float], angles: Sequence[float]) -> tuple[Profile, ...]:
        """Returns the profile of each angle [rad]."""
        largest = max(angles)
        return tuple(
            designed_profile(rig, angle, self.torque * (angle / largest) ** self.growth, self.pause)
            for angle in angles
        )


def final_turn(model: Model, profile: Profile) -> float:
    """Returns the change of the hub's sensor reading from rest to rest [rad], as a mean over the last half second."""
    reading = simulate(model, profile.recording(), Start())["hub_angle"]
    return float(reading[4:].mean() - reading[0])
