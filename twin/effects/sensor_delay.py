"""Channels that arrive late."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from twin.effects.base import OPEN, Effect, EffectParameter


class SensorDelay(Effect):
    """reading(t) = value(t - delay), of the hub angle, the link's sensors and the torque where their choice is 1."""

    name = "sensor-delay"
    meaning = "channels that arrive late"
    acts_on = "sensors"
    parameters = (
        EffectParameter("delay", "s", 0.0, (0.0, 0.05), 1e-3),
        EffectParameter("hub_angle", "1", 1.0, (0.0, 1.0), 1.0, "hub_angle", choice=True),
        EffectParameter("strain", "1", 1.0, (0.0, 1.0), 1.0, choice=True),
        EffectParameter("motor_torque", "1", 0.0, (0.0, 1.0), 1.0, "motor_torque", choice=True),
    )
    along = ("hub_angle", "strain", "motor_torque")

    def starts(self, rig):
        which = ((1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        return tuple({"delay": 1e-3, **dict(zip(self.along, late, strict=True))} for late in which)

    def resolved(self, values, period):
        return values["delay"] >= OPEN * period

    def reading(self, reading, channel, p):
        return replace(reading, delay=self._delay_of(channel, p))

    def sensing(self, time, channels, p):
        late = {ch: self._delay_of(ch, p) for ch in channels}
        said = {ch: _read_at(time, v, time - late[ch]) for ch, v in channels.items()}
        if "motor_torque" in channels:
            said["motor_torque"] = _held(time, channels["motor_torque"], time - late["motor_torque"])
        return said

    def _delay_of(self, channel, p):
        return p[channel if channel in ("hub_angle", "motor_torque") else "strain"] * p["delay"]

    def hub_late(self, p):
        return p["delay"] if p["hub_angle"] else 0.0

    def hub_angle_of(self, time, reading, p):
        return _read_at(time, reading, time + self.hub_late(p))


def _read_at(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) at other instants; the first and the last one hold beyond the ends.

    A simulation that ran away stays as it is.
    """
    if len(time) < 2 or np.array_equal(at, time) or not np.isfinite(values).all():
        return values
    return CubicSpline(time, values)(np.clip(at, time[0], time[-1]))


def _held(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) that are held from each instant to the next, at other instants."""
    return values[np.maximum(np.searchsorted(time, at + 1e-9, side="right") - 1, 0)]
