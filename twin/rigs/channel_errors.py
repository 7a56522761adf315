"""Gain and delay of measured channels, uncertain as a campaign declares: nuisance parameters of a fit, no effects.

    reading(t) = gain * value(t - delay)

behind everything that an effect does to the sensor. Of `torque_command`, whose reading is what the drive is asked for,
they are those of the drive: delivered(t) = gain * torque(t - delay).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from twin.effects import REGISTRY, Drive
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

    def of(self, kind: str, channel: str) -> float | None:
        """The "gain" or "delay" of a channel; None where it has none."""
        return (self.gains if kind == "gain" else self.delays).get(channel)

    def without(self, errors: Collection[tuple[str, str]]) -> ChannelErrors:
        """These errors without some, each ("gain" or "delay", channel)."""
        gains = {c: gain for c, gain in self.gains.items() if ("gain", c) not in errors}
        return ChannelErrors(gains, {c: d for c, d in self.delays.items() if ("delay", c) not in errors})

    def read(self, time: np.ndarray, true: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Readings (name -> (m,), SI) for the values of channels without these errors, at instants (m) [s]."""
        if not self.gains and not self.delays:
            return true
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


def replaced_errors(effects: Mapping[str, Mapping[str, float]]) -> set[tuple[str, str]]:
    """Errors of channels, ("gain" or "delay", channel), that some of these effects are."""
    return {error for name, p in effects.items() for error in REGISTRY[name].replaced_errors(p)}


def with_replaced_errors(name: str, values: Mapping[str, float], errors: ChannelErrors) -> dict[str, float]:
    """Values of an effect with which it does what it did beside the errors of channels that it replaces.

    Of delays that differ between channels it takes the mean.
    """
    effect, replaced, changed = REGISTRY[name], REGISTRY[name].replaced_errors(values), dict(values)
    for p in effect.parameters:
        own = [error for error in effect.channel_errors.get(p.name, ()) if error in replaced]
        known = [(kind, value) for kind, c in own if (value := errors.of(kind, c)) is not None]
        gains, delays = ([v for kind, v in known if kind == which] for which in ("gain", "delay"))
        value = values[p.name] * float(np.prod(gains)) + (float(np.mean(delays)) if delays else 0.0)
        if known:
            changed[p.name] = float(np.clip(value, *p.bounds))
    return changed


def _at(channel: str, time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) of a channel at other instants (m); linear for the motor torque, which jumps with its command."""
    return np.interp(at, time, values) if channel == "motor_torque" else interpolated(time, values, at)
