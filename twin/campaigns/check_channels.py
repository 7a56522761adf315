"""Channels that count the wrong way round, or in another unit than is said.

Slower than the vibrations a planar link on a hub knows three proportions: torque speeds the hub up by its inertia, the
link lags behind, and the drive gives what is commanded. Springs, dry and viscous friction and gravity are allowed for
by regression; what still goes against these proportions, or by far too little or too much, is a channel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from twin.campaigns import check_rig, schema
from twin.errors import InputError
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS, Recording, Sensor

_SPAN = 4.0  # periods of the first mode over which a vibration averages out
_SAMPLES = 32  # instants in a span
_SHORTEST = 6.0  # spans
_CLEAR = 0.6
"""Partial correlation from which a proportion is clear; channels that count the right way have 0.07 to 1."""
_SHARE = 0.3
"""Share of a channel's variation that has to be slower than the vibrations for it to be judged."""
_FACTOR = 30.0
"""Times too large or too small from which it is the unit; between 1, with all physics that may be missing, and 1000."""
_ALIKE = 3.0  # times by which proportions may differ that have one cause
_SHAPE = ("strain_base", "strain_mid", "tip_deflection", "tip_acceleration")


def check_signs_and_units(recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig) -> None:
    """Makes sure that no channel counts the wrong way round or in another unit than is said.

    Raises:
      InputError: one does, in at least one recording.
    """
    faults: dict[str, dict[str, float]] = {}
    for recording in recordings:
        for channel, times in _faults(_proportions(recording, sensors, rig)).items():
            faults.setdefault(channel, {})[recording.name] = times
    for channel, found in faults.items():
        raise InputError(f"{schema.FILE}: channels.{channel}: {_complaint(channel, found)}")


def _complaint(channel: str, found: Mapping[str, float]) -> str:
    """What is wrong with a channel, and what would be right. `found`: recording -> times too large, signed."""
    files, times = ", ".join(found), float(np.median(list(found.values())))
    if not _is_unit_error(times):
        return (
            f"it counts the wrong way round in {files}: {_WHY[channel]}. Expected {_EXPECTED[channel]}; turn the "
            "sign of its gain (no gain is a gain of 1)"
        )
    size, way = (abs(times), "large") if abs(times) > 1 else (1 / abs(times), "small")
    unit = CHANNEL_UNITS[channel]
    return (
        f"it is some {float(f'{size:.1g}'):.0f} times too {way} in {files}, beside the other channels and the declared "
        f"rig; expected it in {'SI units' if unit == '1' else unit} behind unit and gain: check both"
    )


_BENT = "the link bends forward where the hub speeds up"
_STRAIN = "a strain that is positive where the link is bent towards positive angles"
_WHY = {
    "torque_command": "the hub speeds up against it",
    "hub_angle": "it speeds up against torque_command",
    "motor_torque": "it falls where torque_command rises",
    "tip_acceleration": "the tip slows down where the hub speeds up",
} | dict.fromkeys(("strain_base", "strain_mid", "tip_deflection"), _BENT)
_EXPECTED = {
    "torque_command": "a torque that is positive towards positive angles",
    "hub_angle": "an angle that counts in the direction of the torque",
    "motor_torque": "a torque that is positive towards positive angles",
    "strain_base": _STRAIN,
    "strain_mid": _STRAIN,
    "tip_deflection": "a deflection that is positive towards positive angles",
    "tip_acceleration": "an acceleration that is positive towards positive angles",
}


# Which channel it is


def _faults(times: Mapping[str, float]) -> dict[str, float]:
    """Channel -> times too large, of those at fault, as far as it can be told which.

    Args:
      times: channel -> its proportion to what it goes with, in units of what is declared; the torque's and those of
        the link are to the acceleration of the hub.
    """
    shape = [c for c in _SHAPE if c in times]
    wrong = {c: times[c] for c in shape if _is_wrong(times[c])}
    pushed, read = times.get("torque_command"), times.get("motor_torque", 1.0)
    if pushed is None:
        return wrong if len(wrong) < len(shape) else {}
    if not _is_wrong(pushed):
        return wrong | ({"motor_torque": read} if _is_wrong(read) else {})
    one_cause = all(1 / _ALIKE < times[c] / pushed < _ALIKE for c in shape)
    if one_cause and (shape or not _is_wrong(read)):
        return {"hub_angle": 1 / pushed}
    return {"torque_command": pushed} | wrong


def _is_wrong(times: float) -> bool:
    return times < 0 or _is_unit_error(times)


def _is_unit_error(times: float) -> bool:
    return abs(math.log(abs(times))) > math.log(_FACTOR)


# Proportions


def _proportions(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> dict[str, float]:
    """Channel -> its slow proportion to the hub's acceleration, or the command, per declared one; only clear ones."""
    span = _SPAN * check_rig.vibration_period(recording, rig)
    if recording.clamped or "hub_angle" not in recording or recording.duration < _SHORTEST * span:
        return {}
    slow = _LowPassed(recording, span)
    ones = np.ones_like(slow.acceleration)
    at_hub = (ones, slow.mean("hub_angle"), slow.rate, slow.direction)
    found = {"torque_command": slow.slope("torque_command", at_hub) / check_rig.inertia(rig)}
    for channel in _SHAPE:
        if channel in recording:
            found[channel] = slow.slope(channel, at_hub[:2]) / _declared(sensors[channel], rig)
    if "motor_torque" in recording:
        found["motor_torque"] = slow.slope("motor_torque", (ones,), slow.mean("torque_command"))
    return {channel: times for channel, times in found.items() if times}


def _declared(sensor: Sensor, rig: Rig) -> float:
    """What a sensor of the link reads per acceleration of the hub, while nothing vibrates [SI s^2].

    The link bears its own inertia and that of the payload (Euler-Bernoulli beam under a load that grows with the
    distance from the hub).
    """
    length, density, stiffness = rig["length"], rig["linear_density"], rig["bending_stiffness"]
    mass, inertia = rig["tip_mass"], rig["tip_inertia"]
    if sensor.channel == "tip_acceleration":
        return length
    if sensor.channel == "tip_deflection":
        tip = 11 / 120 * density * length**5 + mass * length**4 / 3 + inertia * length**2 / 2
        return -tip / stiffness
    x = sensor.position
    moment = density * ((length**3 - x**3) / 3 - x * (length**2 - x**2) / 2)
    return -sensor.half_thickness * (moment + mass * length * (length - x) + inertia) / stiffness


class _LowPassed:
    """A recording behind a triangular mean that no vibration passes; its second difference is the acceleration."""

    def __init__(self, recording: Recording, span: float):
        self._recording, self._step = recording, span / _SAMPLES
        self._instants = np.arange(recording.time[0], recording.time[-1], self._step)
        angle = self._on_grid("hub_angle")
        n, near = _SAMPLES, _SAMPLES // 8
        self.acceleration = (angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]) / span**2
        rate = np.full_like(angle, np.nan)
        rate[near:-near] = (angle[2 * near :] - angle[: -2 * near]) / (2 * near * self._step)
        self.rate = _triangular_mean(rate)
        self.direction = _triangular_mean(np.sign(rate))

    def mean(self, channel: str) -> np.ndarray:
        """Triangular mean of a channel (m); NaN near a gap."""
        return _triangular_mean(self._on_grid(channel))

    def slope(self, channel: str, others: Sequence[np.ndarray], cause: np.ndarray | None = None) -> float:
        """Change of a channel with a cause (m), the acceleration unless said, given others (m each); 0 if unclear."""
        cause = self.acceleration if cause is None else cause
        values = self.mean(channel)
        known = np.isfinite(np.stack([values, cause, *others])).all(axis=0)
        if np.count_nonzero(known) < 2 * _SAMPLES:
            return 0.0
        basis = np.linalg.qr(np.column_stack([other[known] for other in others]))[0]
        left, pushed = (v[known] - basis @ (basis.T @ v[known]) for v in (values, cause))
        if np.sqrt(np.mean(left**2)) < _SHARE * np.nanstd(self._recording[channel]):
            return 0.0
        length = float(np.linalg.norm(left) * np.linalg.norm(pushed))
        product = float(left @ pushed)
        return product / float(pushed @ pushed) if abs(product) > _CLEAR * length else 0.0

    def _on_grid(self, channel: str) -> np.ndarray:
        time, values = self._recording.time, self._recording[channel]
        known = np.isfinite(values)
        if not known.any():
            return np.full_like(self._instants, np.nan)
        found = np.interp(self._instants, time[known], values[known])
        far = check_rig.distance_to_nearest(self._instants, time[known]) > self._step * _SAMPLES / 8
        return np.where(far, np.nan, found)


def _triangular_mean(values: np.ndarray) -> np.ndarray:
    rising = np.arange(1, _SAMPLES + 1)
    kernel = np.concatenate([rising, rising[-2::-1]]) / _SAMPLES**2
    return np.convolve(values, kernel, "same")[_SAMPLES:-_SAMPLES]
