"""Channels that arrive late."""

import numpy as np
from scipy.interpolate import CubicSpline

from twin.effects.base import Effect, EffectParameter


class SensorDelay(Effect):
    """reading(t) = value(t - delay), of the hub angle and of the link's sensors where their choice is 1."""

    name = "sensor-delay"
    parameters = (
        EffectParameter("delay", "s", 0.0, (0.0, 0.05), 1e-3),
        EffectParameter("hub_angle", "1", 1.0, (0.0, 1.0), 1.0, "hub_angle", choice=True),
        EffectParameter("strain", "1", 1.0, (0.0, 1.0), 1.0, choice=True),
    )
    along = ("hub_angle", "strain")

    def starts(self, rig):
        which = ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0))
        return tuple({"delay": 1e-3, "hub_angle": hub, "strain": link} for hub, link in which)

    def sensing(self, time, channels, p):
        late = {ch for ch in channels if p["hub_angle" if ch == "hub_angle" else "strain"]}
        late -= {"motor_torque"}
        return {ch: _read_at(time, v, time - p["delay"]) if ch in late else v for ch, v in channels.items()}

    def hub_angle_of(self, time, reading, p):
        return _read_at(time, reading, time + p["delay"]) if p["hub_angle"] else reading


def _read_at(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m) at other instants; the first and the last one hold beyond the ends.

    A simulation that ran away stays as it is.
    """
    if len(time) < 2 or np.array_equal(at, time) or not np.isfinite(values).all():
        return values
    return CubicSpline(time, values)(np.clip(at, time[0], time[-1]))
