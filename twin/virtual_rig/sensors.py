"""Data acquisition: gains, drifts, clipping, noise and quantisation of the sensors, and defects of the data."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import InputError, nearest
from twin.virtual_rig.beam import Array, Link, curvature_at
from twin.virtual_rig.plant import Motion, delivered_torque, hub_angle, quantised, sensed_hub, torsion_angle
from twin.virtual_rig.rig import Rig

# Strain of the bridges at base and middle by the torsional oscillator, per rad relative to the hub. Assumed: no source
# gives values.
TORSION_STRAIN = np.array([5.12e-3, 3.58e-3])

DIRT = ("missing-fields", "spikes", "dropped-rows", "jitter", "stuck", "saturated", "bad-segment")


@dataclass(frozen=True)
class Sensors:
    """The data acquisition: standard deviations of white noise, and quantisation steps of the converter (16 bit)."""

    sample_rate: float = 500.0  # Hz
    hub_noise: float = 3e-4  # rad
    strain_noise: float = 2e-6
    torque_noise: float = 1e-3  # N m
    hub_step: float = 1e-4  # rad; 0 for none
    strain_step: float = 1e-7
    torque_step: float = 1e-5  # N m, of the commanded and the measured torque
    position_base: float = 0.02  # m from the hub axis
    position_mid: float = 0.21  # m from the hub axis
    half_thickness: float = 0.0008  # m, neutral axis to gauge


class Sensed(NamedTuple):
    """What the sensors of a rig are exposed to at the times of their readings."""

    commands: Array  # (samples,) [N m]
    hub_angle: Array  # (samples,) [rad]
    strain: Array  # (samples, 2), of the gauges at base and middle by bending
    torsion: Array  # (samples,), of the torsional oscillator relative to the hub [rad]


def noise_of(sensors: Sensors, samples: int, generator: np.random.Generator) -> dict[str, Array]:
    """Returns the noise of every measured channel (samples,) in its unit."""
    spread = {
        "hub_angle": sensors.hub_noise,
        "strain_base": sensors.strain_noise,
        "strain_mid": sensors.strain_noise,
        "motor_torque": sensors.torque_noise,
    }
    return {channel: sigma * generator.standard_normal(samples) for channel, sigma in spread.items()}


def measured(
    rig: Rig, link: Link, sensors: Sensors, times: Array, motion: Motion, noise: Mapping[str, Array]
) -> dict[str, Array]:
    """Returns the readings of a motion: the measured channels by name (samples,) in SI units."""
    return readings(rig, sensors, times, sensed(rig, link, sensors, motion), noise)


def sensed(rig: Rig, link: Link, sensors: Sensors, motion: Motion) -> Sensed:
    """Returns what the sensors are exposed to in a motion."""
    bends = curvature_at(rig, np.array([sensors.position_base, sensors.position_mid]), len(link.stiffness))
    return Sensed(
        commands=motion.commands,
        hub_angle=hub_angle(rig, link, motion.states),
        strain=sensors.half_thickness * motion.states[:, : len(link.stiffness)] @ bends.T,
        torsion=torsion_angle(rig, link, motion.states),
    )


def readings(
    rig: Rig, sensors: Sensors, times: Array, sensed: Sensed, noise: Mapping[str, Array]
) -> dict[str, Array]:
    """Returns the readings of exposed sensors: the measured channels by name (samples,) in SI units."""
    strain = sensed.strain + np.outer(sensed.torsion, TORSION_STRAIN)
    torque = delivered_torque(rig, times, sensed.commands)
    base = rig.gain_base * strain[:, 0] + rig.drift_base * times + rig.pickup_base * torque
    mid = rig.gain_mid * strain[:, 1] + rig.drift_mid * times + rig.pickup_mid * torque
    base, mid = np.clip(base, -rig.clip_base, rig.clip_base), np.clip(mid, -rig.clip_mid, rig.clip_mid)
    hub = sensed_hub(rig, sensed.hub_angle)
    return {
        "hub_angle": quantised(hub + noise["hub_angle"], sensors.hub_step),
        "strain_base": quantised(base + noise["strain_base"], sensors.strain_step),
        "strain_mid": quantised(mid + noise["strain_mid"], sensors.strain_step),
        "motor_torque": quantised(torque + noise["motor_torque"], sensors.torque_step),
    }


def checked_dirt(kinds: Iterable[str]) -> tuple[str, ...]:
    """Returns the kinds of defects.

    Raises:
        InputError: for an unknown kind.
    """
    kinds = tuple(kinds)
    for kind in kinds:
        if kind not in DIRT:
            raise InputError(f"dirt is '{kind}'; expected one of: {', '.join(DIRT)}{nearest(kind, DIRT)}")
    return kinds


def sample_times(
    sensors: Sensors, samples: int, kinds: Iterable[str], generator: np.random.Generator
) -> Array:
    """Returns the sample times (samples,) [s], increasing from 0; jitter has a deviation of 12 % of a period."""
    period = 1.0 / sensors.sample_rate
    times = np.arange(samples) * period
    if "jitter" in kinds:
        times[1:] += period * np.clip(0.12 * generator.standard_normal(samples - 1), -0.3, 0.3)
    return np.round(times, 5)


def soiled(
    table: Mapping[str, Array], sensors: Sensors, kinds: Iterable[str], generator: np.random.Generator
) -> tuple[dict[str, Array], dict[str, list[float]]]:
    """Returns a recording with defects in its measured channels, and the times of each defect by kind [s].

    Args:
        table: Columns of the recording by name (samples,), with `time` and `torque_command`.
        sensors: For the size of spikes, 30 to 300 noise levels.
        kinds: Names of `DIRT`; jitter concerns the sample times and does not change the table.
        generator: Of random numbers.
    """
    result = {name: column.copy() for name, column in table.items()}
    defects: dict[str, list[float]] = {}
    times = table["time"]
    channels = [name for name in ("hub_angle", "strain_base", "strain_mid") if name in table]
    if "spikes" in kinds:
        rows = np.sort(generator.choice(len(times), size=3, replace=False))
        for row in rows:
            name = channels[generator.integers(len(channels))]
            sigma = sensors.hub_noise if name == "hub_angle" else sensors.strain_noise
            result[name][row] += generator.choice([-1, 1]) * sigma * 10 ** generator.uniform(1.5, 2.5)
        defects["spikes"] = times[rows].tolist()
    if "missing-fields" in kinds:
        defects["missing-fields"] = []
        for name in channels:
            gone = _bursts(len(times), 0.01, generator)
            result[name][gone] = np.nan
            defects["missing-fields"] += times[gone].tolist()
    if "dropped-rows" in kinds:
        gone = _bursts(len(times), 0.01, generator)
        # The command is held between rows: only rows without a new command are dropped.
        gone &= np.append(False, np.diff(table["torque_command"]) == 0.0)
        defects["dropped-rows"] = times[gone].tolist()
        result = {name: column[~gone] for name, column in result.items()}
    defects |= _broken_channels(result, channels, sensors, kinds, generator)
    return result, defects


def _broken_channels(
    table: dict[str, Array],
    channels: Sequence[str],
    sensors: Sensors,
    kinds: Iterable[str],
    generator: np.random.Generator,
) -> dict[str, list[float]]:
    """Adds a defect to an interval of one channel for each of these kinds, and returns the times by kind [s].

    A bad segment has 10 to 20 times the noise for 0.3 to 0.6 s, a saturated bridge stays within 0.5 to 0.8 of its
    largest reading, a stuck channel repeats a reading for 0.5 to 1 s.
    """
    found = {}
    times = table["time"]
    if "bad-segment" in kinds:
        name, inside = _stretch(times, channels, (0.3, 0.6), generator)
        sigma, step = sensors.hub_noise, sensors.hub_step
        if name != "hub_angle":
            sigma, step = sensors.strain_noise, sensors.strain_step
        more = generator.uniform(10, 20) * sigma * generator.standard_normal(int(inside.sum()))
        table[name][inside] = quantised(table[name][inside] + more, step)
        found["bad-segment"] = times[inside].tolist()
    if "saturated" in kinds:
        name = ("strain_base", "strain_mid")[int(generator.integers(2))]
        full_scale = generator.uniform(0.5, 0.8) * np.nanmax(np.abs(table[name]))
        level = quantised(np.array([full_scale]), sensors.strain_step)[0]
        found["saturated"] = times[np.abs(table[name]) > level].tolist()
        table[name] = np.clip(table[name], -level, level)
    if "stuck" in kinds:
        name, inside = _stretch(times, channels, (0.5, 1.0), generator)
        known = inside & np.isfinite(table[name])
        table[name][known] = table[name][known][0]
        found["stuck"] = times[known].tolist()
    return found


def _stretch(
    times: Array, channels: Sequence[str], spans: tuple[float, float], generator: np.random.Generator
) -> tuple[str, NDArray[np.bool_]]:
    """Returns a channel and a mask (samples,) of an interval of random length [s], away from both ends."""
    name = channels[int(generator.integers(len(channels)))]
    span = generator.uniform(*spans)
    first = generator.uniform(0.1, 0.8) * (times[-1] - times[0])
    return name, (times >= first) & (times < first + span)


def _bursts(samples: int, share: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    """Returns a mask (samples,) with about this share of samples set, in bursts of 1 to 9."""
    mask = np.zeros(samples, dtype=bool)
    for start in generator.integers(1, samples, size=max(1, int(samples * share / 5))):
        mask[start : start + generator.integers(1, 10)] = True
    return mask
