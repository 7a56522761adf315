"""Delay of sensor readings."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from twin.effects.base import TIMES, TIMING_TOLERANCE, Effect, EffectParameter
from twin.recording import LONGEST_DELAY, MEASURED

_CHOICES = {"hub_angle": "hub_angle", "hub_rate": "hub_angle", "motor_torque": "motor_torque"}
"""Channel -> choice that says whether it is late; of all others "strain"."""


class SensorDelay(Effect):
    """Reading(t) = value(t - delay) of the channels whose choice is 1: hub, sensors of the link, motor torque."""

    name = "sensor-delay"
    meaning = "a delay of sensor readings"
    acts_on = "sensors"
    seen_as = (
        "Readings follow the motion late by the same time, whatever moves the rig; between fast channels and slow ones "
        "it looks like a phase that grows with frequency."
    )
    mistaken_for = {
        "actuator-lag": "a free vibration, in which no command takes part",
    }
    source = "K. J. Åström and B. Wittenmark, Computer-Controlled Systems, 1997"
    parameters = (
        EffectParameter("delay", "s", 0.0, (0.0, LONGEST_DELAY), 1e-3, possible=TIMES),
        EffectParameter("hub_angle", "1", 1.0, (0.0, 1.0), 1.0, "hub_angle", choice=True),
        EffectParameter("strain", "1", 1.0, (0.0, 1.0), 1.0, choice=True),
        EffectParameter("motor_torque", "1", 0.0, (0.0, 1.0), 1.0, "motor_torque", choice=True),
    )
    undefined_at_neutral = ("hub_angle", "strain", "motor_torque")
    # A tachometer may be late by itself: its own delay stays free beside that of the hub angle.
    channel_errors = {"delay": tuple(("delay", channel) for channel in MEASURED if channel != "hub_rate")}

    def starts(self, rig):
        which = ((1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        return tuple(
            {"delay": 1e-3, **dict(zip(self.undefined_at_neutral, late, strict=True))} for late in which
        )

    def replaced_errors(self, p):
        return {(kind, ch) for kind, ch in super().replaced_errors(p) if p[_CHOICES.get(ch, "strain")]}

    def is_resolved(self, values, period):
        return values["delay"] >= TIMING_TOLERANCE * period

    def reading(self, reading, channel, p):
        return replace(reading, delay=self._delay_of(channel, p))

    def sensing(self, time, channels, p):
        delays = {ch: self._delay_of(ch, p) for ch in channels}
        delayed = {ch: interpolated(time, v, time - delays[ch]) for ch, v in channels.items()}
        if "motor_torque" in channels:
            delayed["motor_torque"] = _held(time, channels["motor_torque"], time - delays["motor_torque"])
        return delayed

    def _delay_of(self, channel, p):
        return p[_CHOICES.get(channel, "strain")] * p["delay"]

    def hub_delay(self, p):
        return p["delay"] if p["hub_angle"] else 0.0

    def hub_angle_of(self, time, reading, p):
        return interpolated(time, reading, time + self.hub_delay(p))


def interpolated(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) interpolated at other instants by a cubic spline; constant behind the last, and before the first as if
    they had changed at the rate there: what a late sensor first shows of a rig that moves is older than its simulation.

    Values of a diverged simulation, not all finite, are returned unchanged.
    """
    if len(time) < 2 or np.array_equal(at, time) or not np.isfinite(values).all():
        return values
    spline = CubicSpline(time, values)
    return spline(np.clip(at, time[0], time[-1])) + spline(time[0], 1) * np.minimum(at - time[0], 0.0)


def _held(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) at other instants, with a zero-order hold from each instant to the next."""
    return values[np.maximum(np.searchsorted(time, at + 1e-9, side="right") - 1, 0)]
