"""Gain and delay of measured channels, uncertain as a campaign declares: nuisance parameters of a fit, no effects.

    reading(t) = gain * value(t - delay)

behind everything that an effect does to the sensor. Of `torque_command`, whose reading is what the drive is asked for,
they are those of the drive: delivered(t) = gain * torque(t - delay).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from twin.effects import Drive
from twin.effects.sensor_delay import interpolated

COMMAND = "torque_command"


@dataclass(frozen=True)
class ChannelErrors:
    """Errors of the channels of a campaign; a channel that is not listed has none.

    Attributes:
      gains: channel -> gain [1].
      delays: channel -> delay of the readings against their time stamps [s]; negative where they are early.
    """

    gains: Mapping[str, float] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)

    def read(self, time: np.ndarray, true: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Readings (name -> (m,), SI) for the values of channels without these errors, at instants (m) [s]."""
        late = {c: _at(c, time, v, time - self.delays[c]) for c, v in true.items() if c in self.delays}
        read = {**true, **late}
        return {**read, **{c: gain * read[c] for c, gain in self.gains.items() if c in read}}

    def value_of(self, channel: str, time: np.ndarray, reading: np.ndarray) -> np.ndarray:
        """Values (m) of a channel for its readings (m) at instants (m) [s]: the inverse of `read`."""
        if channel in self.gains:
            reading = reading / self.gains[channel]
        if channel in self.delays:
            reading = _at(channel, time, reading, time + self.delays[channel])
        return reading

    def driven(self, drive: Drive) -> Drive:
        """The delivered torque with the gain of the command."""
        gain = self.gains.get(COMMAND)
        if gain is None:
            return drive
        return drive.replace(torque=gain * drive.torque, before=gain * drive.before)


def _at(channel: str, time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) of a channel at other instants (m); linear for the motor torque, which jumps with its command."""
    return np.interp(at, time, values) if channel == "motor_torque" else interpolated(time, values, at)
