"""One experiment as an immutable value: the same type for what a rig measured and what a simulation predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np

CHANNEL_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "torque_command": "N*m",
        "motor_torque": "N*m",
        "hub_reference": "rad",
        "hub_angle": "rad",
        "hub_rate": "rad/s",
        "strain_base": "1",
        "strain_mid": "1",
        "tip_deflection": "m",
        "tip_acceleration": "m/s^2",
    }
)
"""Channel of the recording format -> its SI unit."""

MEASURED = (
    "hub_angle",
    "hub_rate",
    "strain_base",
    "strain_mid",
    "tip_deflection",
    "tip_acceleration",
    "motor_torque",
)
"""Channels that a simulation predicts, in the order of all tables."""

ON_LINK = ("strain_base", "strain_mid", "tip_deflection", "tip_acceleration")
"""Channels of sensors on the link."""

LONGEST_DELAY = 0.05
"""Delay of a sensor that is tried at most [s]: a third of a period at 7 Hz."""

ON_HUB = ("hub_angle", "hub_rate")
"""Channels of sensors of the hub's motion."""

HUB_TORQUE = "hub_torque"
"""Name under which residuals of the hub's torque balance are listed beside those of the channels."""


SPARSEST = 20.0
"""Largest span of a recording over that of as many samples at its median period [1]: nineteen of twenty samples lost.
Uniform grids are laid over the span, so that this bounds their memory by the number of samples."""

GAP = 2.5
"""Sample periods between two readings beyond which others between them are missing; of rows, the command with them.

Halfway between one lost reading, which its neighbours tell, and two."""


@dataclass(frozen=True)
class Sensor:
    """How a channel was measured.

    Attributes:
      channel: name of the channel.
      noise: standard deviation of the sensor noise, SI; None where not declared.
      position: distance of a strain gauge from the hub axis along the link [m].
      half_thickness: distance of a strain gauge from the neutral axis [m]; strain = half_thickness * w''.
      zero_is_certain: whether its reading at rest without load is 0 for certain. If not, that of a sensor on the link
        or of a tachometer is a nuisance parameter of each recording.
      sees_gain: of `motor_torque`, whether it sees an error of the drive's gain; None where not declared.
      gain_uncertainty: relative standard deviation of its gain; 0 for a gain that is certain.
      delay_uncertainty: standard deviation of the delay of its readings [s]; 0 for time stamps that are certain.
    """

    channel: str
    noise: float | None = None
    position: float = 0.0
    half_thickness: float = 0.0
    zero_is_certain: bool = False
    sees_gain: bool | None = None
    gain_uncertainty: float = 0.0
    delay_uncertainty: float = 0.0

    @property
    def has_unknown_zero(self) -> bool:
        """Whether the zero is a nuisance parameter: of sensors on the link and tachometers, unless it is certain."""
        return not self.zero_is_certain and self.channel in (*ON_LINK, "hub_rate")


GAUGES = (
    Sensor("strain_base", position=0.02, half_thickness=0.001),
    Sensor("strain_mid", position=0.21, half_thickness=0.001),
)
"""Strain gauges of the files in `models/`: at the base and in the middle of a link that is 2 mm thick."""


def gauges_on(length: float) -> dict[str, Sensor]:
    """Channel -> gauge of `GAUGES`; on a link of a length [m] whose middle is nearer, in the same proportion nearer."""
    share = min(1.0, length / 2 / GAUGES[-1].position)
    return {gauge.channel: replace(gauge, position=share * gauge.position) for gauge in GAUGES}


@dataclass(frozen=True)
class Recording:
    """One experiment, measured or simulated, in SI units.

    Attributes:
      name: for people: name of a file or scenario. No result depends on it.
      time: (n) instants [s], strictly increasing, not necessarily uniform.
      channels: name -> (n) values, SI; NaN where a sample is missing. `torque_command` is held from its
        sample to the next, except where rows are missing: see `commands`.
      clamped: the hub is locked.
      loop: "open" where torque_command was prescribed, "closed" where a controller computed it.
      initial_tip_deflection: tip deflection [m] held by a force until the first sample, then released; None: not so.
      start: "rest", or "unknown" where the rig was already moving at the first sample.
      command_time: (n) instants from which each torque_command sample is held [s]; None: those of `time`.
      sampled: the rows are the samples of a clock, so that rows between them that are far apart were lost.

    Raises:
      ValueError: a channel is unknown, or an array is no vector of the length of `time`.
    """

    name: str
    time: np.ndarray
    channels: Mapping[str, np.ndarray] = field(repr=False)
    clamped: bool = False
    loop: Literal["open", "closed"] = "open"
    initial_tip_deflection: float | None = None
    start: Literal["rest", "unknown"] = "rest"
    command_time: np.ndarray | None = field(default=None, repr=False)
    sampled: bool = False

    def __post_init__(self) -> None:
        time = _frozen(self.time)
        channels = {name: _frozen(values) for name, values in self.channels.items()}
        for name, values in channels.items():
            if name not in CHANNEL_UNITS:
                raise ValueError(f"'{name}' is not a channel. Expected one of: {', '.join(CHANNEL_UNITS)}")
            if values.shape != time.shape:
                raise ValueError(f"{name} has shape {values.shape}; expected that of time, {time.shape}")
        object.__setattr__(self, "time", time)
        if self.command_time is not None:
            object.__setattr__(self, "command_time", _frozen(self.command_time))
        object.__setattr__(self, "channels", MappingProxyType(channels))

    @property
    def period(self) -> float:
        """Usual time between two samples [s], see `sample_period`."""
        return sample_period(self.time)

    @property
    def commanded_at(self) -> np.ndarray:
        """(n) instants from which each command is held [s]."""
        return self.time if self.command_time is None else self.command_time

    @cached_property
    def commands(self) -> tuple[np.ndarray, np.ndarray]:
        """Instants (k) [s] and torque commands held from each to the next (k) [N m].

        Where rows are missing the command is unknown. It then goes from the one before to the one behind in a step at
        each period: the expectation of a command that steps at any instant between them.
        """
        held, torque, gaps = self.commanded_at, self["torque_command"], self._gaps
        if not gaps.size:
            return held, torque
        period = self.period
        ticks = [np.arange(held[g] + period, held[g + 1] - period / 2, period) for g in gaps]
        between = np.concatenate(ticks)
        order = np.argsort(np.r_[held, between], kind="stable")
        values = np.r_[torque, np.interp(between, held, torque)]
        return np.r_[held, between][order], values[order]

    def with_steps_before_gaps(self) -> Recording | None:
        """The recording with the command behind each gap held from its beginning on; None without missing rows."""
        held, gaps = np.array(self.commanded_at), self._gaps
        if not gaps.size:
            return None
        held[gaps + 1] = held[gaps] + self.period
        return self.replace(command_time=held)

    @property
    def _gaps(self) -> np.ndarray:
        """Indices of the last rows before missing ones (k); none where rows are no samples."""
        return gaps_in(self.commanded_at, self.period) if self.sampled else np.empty(0, dtype=int)

    def __getitem__(self, channel: str) -> np.ndarray:
        return self.channels[channel]

    def __contains__(self, channel: str) -> bool:
        return channel in self.channels

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def measured(self) -> tuple[str, ...]:
        """Returns the channels of this recording that a simulation predicts."""
        return tuple(name for name in MEASURED if name in self.channels)

    def part(self, kept: slice | np.ndarray) -> Recording:
        """Returns the recording of some samples: of a slice, or of a mask (n)."""
        held = None if self.command_time is None else self.command_time[kept]
        channels = {name: values[kept] for name, values in self.channels.items()}
        return self.replace(time=self.time[kept], channels=channels, command_time=held)

    def replace(self, **changes) -> Recording:
        """Returns a recording with some attributes changed."""
        return replace(self, **changes)

    def __reduce__(self):
        fields = (self.name, self.time, dict(self.channels), self.clamped, self.loop)
        more = self.initial_tip_deflection, self.start, self.command_time, self.sampled
        return (type(self), (*fields, *more))


def sample_period(time: np.ndarray) -> float:
    """Returns the median time between two of n instants [s], but at least a share of the mean one.

    A grid of this period thus has at most `SPARSEST` n instants, however close together most of them are.
    """
    median = float(np.median(np.diff(time)))
    return max(median, float(time[-1] - time[0]) / (SPARSEST * len(time)))


def gaps_in(instants: np.ndarray, period: float) -> np.ndarray:
    """Returns the indices of those of n instants behind which others are missing; `period`: usual time between two."""
    return np.flatnonzero(np.diff(instants) > GAP * period)


def _frozen(values: np.ndarray) -> np.ndarray:
    """Returns a read-only copy of a vector of floats."""
    array = np.array(values, dtype=float)
    if array.ndim != 1:
        raise ValueError(f"expected a vector of samples, got shape {array.shape}")
    array.flags.writeable = False
    return array
