"""Channels with the wrong sign, or in another unit than declared.

Below the frequencies of vibration, three ratios of a planar link on a hub are known: torque per hub acceleration from
the inertia, quasi-static bending per hub acceleration from the stiffness, and delivered per commanded torque, 1. Each
is estimated by regression from low-passed channels, with springs, dry and viscous friction and gravity as nuisance
regressors: one ratio for all recordings, then one for each alone. A ratio with the wrong sign, or off by a large
factor, is a fault of a channel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from twin.campaigns import check_rig, schema
from twin.errors import InputError
from twin.mechanics import beam
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS, Recording, Sensor

_SPAN = 4.0  # periods of the first mode; half the width of the triangular mean, which averages vibrations out
_SAMPLES = 32  # grid points per span
_CORRELATED = 1.5
"""Time that is one independent sample [spans]: the inverse of the integral of the squared triangular mean."""
_CHANCE = 1e-3
"""Rate at which chance alone is taken for a clear correlation."""
_CLEAR = 0.6
"""Least partial correlation [1] with which a ratio is judged, also of long recordings: what the nuisance regressors
leave of missing physics does not average out. Channels with the right sign have 0.07 to 1."""
_SHARE = 0.3
"""Least low-passed share of a channel's standard deviation [1] with which it is judged."""
_RATE_FACTOR = 3.0
"""The same of hub_rate: beside hub_angle it is 1 with any physics, so that rev/min (9.5 times) show too."""
_FACTOR = 30.0
"""Factor from which a ratio is a unit error: between 1, with all physics that may be missing, and 1000."""
_ALIKE = 3.0  # factor within which ratios are taken to have one common cause
_SHAPE = ("strain_base", "strain_mid", "tip_deflection", "tip_acceleration")
"""Channels of the link, which are compared with the acceleration of the hub."""


def check_signs_and_units(recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig) -> None:
    """Makes sure that no channel has the wrong sign or another unit than declared.

    Raises:
      InputError: one has, in at least one recording.
    """
    each = [(r.name, _regressions(r, rig)) for r in recordings]
    for together in (each, *([one] for one in each)):
        faults = _faults(_clear([found for _, found in together], sensors, rig))
        for channel, ratio in faults.items():
            # A fault of the hub angle shows in all ratios to its acceleration.
            seen_by = "torque_command" if channel == "hub_angle" else channel
            files = [name for name, found in together if seen_by in found]
            raise InputError(f"{schema.FILE}: channels.{channel}: {_error_text(channel, ratio, files)}")


def _error_text(channel: str, ratio: float, names: Sequence[str]) -> str:
    """What is wrong with a channel, and what is expected. `ratio`: factor too large, signed."""
    files = ", ".join(names)
    if ratio < 0 and not _is_unit_error(ratio):
        return (
            f"it counts the wrong way round in {files}: {_WHY[channel]}. Expected {_EXPECTED[channel]}; turn the "
            "sign of its gain (no gain is a gain of 1)"
        )
    size, way = (abs(ratio), "large") if abs(ratio) > 1 else (1 / abs(ratio), "small")
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
    "hub_rate": "it falls where hub_angle speeds up",
    "motor_torque": "it falls where torque_command rises",
    "tip_acceleration": "the tip slows down where the hub speeds up",
} | dict.fromkeys(("strain_base", "strain_mid", "tip_deflection"), _BENT)
_EXPECTED = {
    "torque_command": "a torque that is positive towards positive angles",
    "hub_angle": "an angle that counts in the direction of the torque",
    "hub_rate": "a rate that is positive where hub_angle rises",
    "motor_torque": "a torque that is positive towards positive angles",
    "strain_base": _STRAIN,
    "strain_mid": _STRAIN,
    "tip_deflection": "a deflection that is positive towards positive angles",
    "tip_acceleration": "an acceleration that is positive towards positive angles",
}


# Channels at fault


def _faults(ratios: Mapping[str, float]) -> dict[str, float]:
    """Returns the channels at fault -> factor too large; empty where the ratios do not tell which channel it is.

    Args:
      ratios: channel -> measured ratio per expected ratio: of motor_torque to the command, of hub_rate to the rate of
        hub_angle, of all others to the acceleration of the hub.
    """
    shape = [c for c in _SHAPE if c in ratios]
    wrong = {c: ratios[c] for c in shape if _is_wrong(ratios[c])}
    command, motor, rate = (ratios.get(c) for c in ("torque_command", "motor_torque", "hub_rate"))
    motor = 1.0 if motor is None else motor
    own = {} if rate is None or not _is_wrong(rate, _RATE_FACTOR) else {"hub_rate": rate}
    if command is None:
        return wrong | own if len(wrong) < max(len(shape), 1) else {}
    if not _is_wrong(command):
        return wrong | own | ({"motor_torque": motor} if _is_wrong(motor) else {})
    # If all ratios to the hub's acceleration are wrong alike, the hub angle is at fault.
    one_cause = all(1 / _ALIKE < ratios[c] / command < _ALIKE for c in shape)
    if one_cause and (shape or not _is_wrong(motor)):
        return {"hub_angle": 1 / command}
    return {"torque_command": command} | wrong | own


def _is_wrong(ratio: float, factor: float = _FACTOR) -> bool:
    return ratio < 0 or _is_unit_error(ratio, factor)


def _is_unit_error(ratio: float, factor: float = _FACTOR) -> bool:
    return abs(math.log(abs(ratio))) > math.log(factor)


# Ratios


def clear_ratios(
    recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig
) -> dict[str, float]:
    """Channel -> its ratio in all recordings to the hub's acceleration, or the command, per expected one, if clear."""
    return _clear([_regressions(recording, rig) for recording in recordings], sensors, rig)


def _clear(
    each: Sequence[Mapping[str, Regression]], sensors: Mapping[str, Sensor], rig: Rig
) -> dict[str, float]:
    """The same of the regressions of each recording."""
    channels = dict.fromkeys(channel for found in each for channel in found)
    slopes = {c: common_slope(found[c] for found in each if c in found) for c in channels}
    return {c: slope / _expected(sensors, rig, c) for c, slope in slopes.items() if slope}


def _expected(sensors: Mapping[str, Sensor], rig: Rig, channel: str) -> float:
    """Ratio of a channel that the declared rig has."""
    if channel == "torque_command":
        return beam.rigid_inertia(rig)
    return _quasi_static_reading(sensors[channel], rig) if channel in _SHAPE else 1.0


def _regressions(recording: Recording, rig: Rig) -> dict[str, Regression]:
    """Channel -> its regression on the hub's acceleration, on its rate (hub_rate), or on the command (motor_torque)."""
    span = _SPAN * check_rig.vibration_period(recording, rig)
    if recording.clamped or "hub_angle" not in recording or recording.duration < 2 * span:
        return {}
    slow = LowPassed(recording, span)
    ones = np.ones_like(slow.acceleration)
    nuisance = (ones, slow.mean("hub_angle"), slow.rate, slow.direction)
    found = {"torque_command": slow.regression("torque_command", nuisance)}
    found |= {c: slow.regression(c, nuisance[:2]) for c in _SHAPE if c in recording}
    if "hub_rate" in recording:
        found["hub_rate"] = slow.regression("hub_rate", (ones,), slow.rate)
    if "motor_torque" in recording:
        found["motor_torque"] = slow.regression("motor_torque", (ones,), slow.mean("torque_command"))
    return {channel: regression for channel, regression in found.items() if regression is not None}


class Regression(NamedTuple):
    """A channel on one regressor, both without what the nuisance regressors explain (Frisch-Waugh-Lovell).

    Attributes:
      response, regressor, product: sum of the squares of either, and of their products.
      degrees: of freedom that are left [1].
    """

    response: float
    regressor: float
    product: float
    degrees: float


def common_slope(regressions: Iterable[Regression]) -> float:
    """Returns the slope that recordings have in common; 0 where their correlation is unclear, or may be chance."""
    response, regressor, product, degrees = np.sum(list(regressions), axis=0)
    if degrees <= 0 or response * regressor <= 0:
        return 0.0
    t = stats.t.isf(_CHANCE / 2, degrees)
    correlation = abs(product) / math.sqrt(response * regressor)
    is_clear = correlation > max(_CLEAR, t / math.hypot(t, math.sqrt(degrees)))
    return float(product / regressor) if is_clear else 0.0


def _quasi_static_reading(sensor: Sensor, rig: Rig) -> float:
    """Reading of a sensor on the link per acceleration of the hub, without vibration [SI s^2].

    Static bending of an Euler-Bernoulli beam under the inertial load of link and payload, which is proportional to the
    distance from the hub.
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


class LowPassed:
    """A recording on a uniform grid, low-passed by a triangular mean that averages vibrations out.

    Attributes:
      acceleration: (m) of the hub [rad/s^2]: the second difference of the angle over `span`, which has the same mean.
      rate: (m) of the hub [rad/s].
      direction: (m) mean sign of the rate [1].
      step: between two values [s].
    """

    def __init__(self, recording: Recording, span: float):
        """Takes the recording and half the width of the mean [s]."""
        self._recording, self.step = recording, span / _SAMPLES
        self._instants = np.arange(recording.time[0], recording.time[-1], self.step)
        angle = self._on_grid("hub_angle")
        n, near = _SAMPLES, _SAMPLES // 8
        self.acceleration = (angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]) / span**2
        rate = np.full_like(angle, np.nan)
        rate[near:-near] = (angle[2 * near :] - angle[: -2 * near]) / (2 * near * self.step)
        self.rate = _triangular_mean(rate)
        self.direction = _triangular_mean(np.sign(rate))

    @property
    def first_rate(self) -> float:
        """The first known rate of the hub [rad/s]; 0 where none is known."""
        known = self.rate[np.isfinite(self.rate)]
        return float(known[0]) if known.size else 0.0

    def mean(self, channel: str) -> np.ndarray:
        """Returns the triangular mean of a channel (m); NaN near a gap."""
        return _triangular_mean(self._on_grid(channel))

    def slope(self, channel: str, others: Sequence[np.ndarray]) -> float:
        """Returns the slope of a channel over the hub's acceleration, as `regression`; 0 where it is unclear."""
        regression = self.regression(channel, others)
        return 0.0 if regression is None else common_slope([regression])

    def regression(
        self, channel: str, others: Sequence[np.ndarray], cause: np.ndarray | None = None
    ) -> Regression | None:
        """Returns the regression of a channel; None where too little of it varies slowly, or it has too few samples.

        Args:
          channel: the channel.
          others: nuisance regressors (m each).
          cause: (m) regressor; None for the acceleration of the hub.
        """
        cause = self.acceleration if cause is None else cause
        values = self.mean(channel)
        known = np.isfinite(np.stack([values, cause, *others])).all(axis=0)
        degrees = np.count_nonzero(known) / (_CORRELATED * _SAMPLES) - len(others) - 1
        if degrees <= 0:
            return None
        basis = np.linalg.qr(np.column_stack([other[known] for other in others]))[0]
        response, regressor = (v[known] - basis @ (basis.T @ v[known]) for v in (values, cause))
        if np.sqrt(np.mean(response**2)) < _SHARE * np.nanstd(self._recording[channel]):
            return None
        sums = (float(response @ response), float(regressor @ regressor), float(response @ regressor))
        return Regression(*sums, degrees)

    def _on_grid(self, channel: str) -> np.ndarray:
        """A channel interpolated to the grid; NaN farther than an eighth of a span from any sample."""
        time, values = self._recording.time, self._recording[channel]
        known = np.isfinite(values)
        if not known.any():
            return np.full_like(self._instants, np.nan)
        gridded = np.interp(self._instants, time[known], values[known])
        far = check_rig.distance_to_nearest(self._instants, time[known]) > self.step * _SAMPLES / 8
        return np.where(far, np.nan, gridded)


def _triangular_mean(values: np.ndarray) -> np.ndarray:
    """Triangular mean of half width `_SAMPLES`; that many values are cut off at each end."""
    rising = np.arange(1, _SAMPLES + 1)
    kernel = np.concatenate([rising, rising[-2::-1]]) / _SAMPLES**2
    return np.convolve(values, kernel, "same")[_SAMPLES:-_SAMPLES]
