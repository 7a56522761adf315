"""Channels that are turned into those of a recording when a campaign is read: motor angle, tip angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin.campaigns.units import DERIVED_UNITS
from twin.recording import Sensor


def derive(
    values: Mapping[str, np.ndarray], gear_ratio: float, length: float
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Returns the channels of a recording, and what was not used.

    The motor turns `gear_ratio` times as far as the hub. The tip angle is that of the line from the hub's axis to the
    tip: hub angle + deflection / length.

    Args:
      values: channel -> (n) readings, SI, derived ones among them.
      gear_ratio: turns of the motor per turn of the hub.
      length: of the link [m].
    """
    channels = {name: v for name, v in values.items() if name not in DERIVED_UNITS}
    used = set()
    if "motor_angle" in values and "hub_angle" not in values:
        channels["hub_angle"] = values["motor_angle"] / gear_ratio
        used.add("motor_angle")
    if "tip_angle" in values and "tip_deflection" not in values and "hub_angle" in channels:
        channels["tip_deflection"] = (values["tip_angle"] - channels["hub_angle"]) * length
        used.add("tip_angle")
    return channels, [name for name in values if name in DERIVED_UNITS and name not in used]


def derived_sensors(sensors: Mapping[str, Sensor], gear_ratio: float, length: float) -> dict[str, Sensor]:
    """Returns the sensors of the channels of `derive`; arguments as there.

    Gain and delay of a tip angle are none of the deflection, which is its difference from the hub angle.
    """
    known = {name: s for name, s in sensors.items() if name not in DERIVED_UNITS}
    for name, channel, factor in (
        ("motor_angle", "hub_angle", 1 / gear_ratio),
        ("tip_angle", "tip_deflection", length),
    ):
        if name in sensors and channel not in known:
            noise = sensors[name].noise
            known[channel] = replace(
                sensors[name], channel=channel, noise=None if noise is None else noise * factor
            )
            if name == "tip_angle":
                known[channel] = replace(known[channel], gain_uncertainty=0.0, delay_uncertainty=0.0)
    return known
