"""Sensors that count the wrong way round: a gauge on the other face of the link, wires that are swapped.

Slower than the vibrations, the signs of a planar link on a hub are fixed: torque speeds the hub up, the link lags
behind. Springs, dry and viscous friction and gravity are allowed for by regression; what still goes against these
signs, and strongly, is a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin import plausibility, schema
from twin.errors import InputError
from twin.parameters import Rig
from twin.recording import Recording

_SPAN = 4.0  # periods of the first mode over which a vibration averages out
_SAMPLES = 32  # instants in a span
_CLEAR = 0.6
"""Partial correlation from which a sign is clear; sensors that count the right way have 0.07 to 1, never less."""
_SHARE = 0.3
"""Share of a channel's variation that has to be slower than the vibrations for its sign to be judged."""
_SHORTEST = 6.0  # spans
_WITH_ACCELERATION = {"strain_base": -1, "strain_mid": -1, "tip_deflection": -1, "tip_acceleration": 1}
"""Sign in which a channel goes with the acceleration of the hub."""


def check(recordings: Sequence[Recording], rig: Rig) -> None:
    """Makes sure that no channel counts the wrong way round.

    Raises:
      InputError: one does, in at least one recording.
    """
    turned: dict[str, list[str]] = {}
    for recording in recordings:
        for channel in _turned(recording, rig):
            turned.setdefault(channel, []).append(recording.name)
    for channel, files in turned.items():
        raise InputError(
            f"{schema.FILE}: channels.{channel}: it counts the wrong way round in {', '.join(files)}: {_WHY[channel]}. "
            f"Expected {_EXPECTED[channel]}; turn the sign of its gain (no gain is a gain of 1)"
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


def _turned(recording: Recording, rig: Rig) -> list[str]:
    """Channels whose sign is turned in this recording, as far as it can be told which."""
    signs = _signs(recording, rig)
    shape = [c for c in _WITH_ACCELERATION if c in signs]
    against = [c for c in shape if signs[c] < 0]
    pushed, read = signs.get("torque_command", 0), signs.get("motor_torque", 0)
    if pushed > 0:
        return [*against, "motor_torque"] if read < 0 else against
    if pushed < 0 and against == shape:
        return ["torque_command"] if read < 0 and not shape else ["hub_angle"]
    if pushed < 0 and not against:
        return ["torque_command"]
    return against if len(against) < len(shape) else []


def _signs(recording: Recording, rig: Rig) -> dict[str, int]:
    """Channel -> whether it goes as it should with the slow acceleration of the hub (1) or against that (-1)."""
    span = _SPAN * plausibility.vibration_period(recording, rig)
    if recording.clamped or "hub_angle" not in recording or recording.duration < _SHORTEST * span:
        return {}
    slow = _Slow(recording, span)
    ones = np.ones_like(slow.acceleration)
    at_hub = (ones, slow.mean("hub_angle"), slow.rate, slow.direction)
    found = {"torque_command": slow.sign("torque_command", at_hub)}
    for channel, sign in _WITH_ACCELERATION.items():
        if channel in recording:
            found[channel] = sign * slow.sign(channel, at_hub[:2])
    if "motor_torque" in recording:
        found["motor_torque"] = slow.sign("motor_torque", (ones,), slow.mean("torque_command"))
    return {channel: sign for channel, sign in found.items() if sign}


class _Slow:
    """A recording behind a triangular mean that no vibration passes; its second difference is the acceleration."""

    def __init__(self, recording: Recording, span: float):
        self._recording, self._step = recording, span / _SAMPLES
        self._instants = np.arange(recording.time[0], recording.time[-1], self._step)
        angle = self._on_grid("hub_angle")
        n, near = _SAMPLES, _SAMPLES // 8
        self.acceleration = (angle[2 * n :] - 2 * angle[n:-n] + angle[: -2 * n]) / span**2
        rate = np.full_like(angle, np.nan)
        rate[near:-near] = (angle[2 * near :] - angle[: -2 * near]) / (2 * near * self._step)
        self.rate = _averaged(rate)
        self.direction = _averaged(np.sign(rate))

    def mean(self, channel: str) -> np.ndarray:
        """Triangular mean of a channel (m); NaN near a gap."""
        return _averaged(self._on_grid(channel))

    def sign(self, channel: str, others: Sequence[np.ndarray], acceleration: np.ndarray | None = None) -> int:
        """Sign of the partial correlation of a channel with the acceleration, given others (m each); 0 if unclear."""
        against = self.acceleration if acceleration is None else acceleration
        values = self.mean(channel)
        known = np.isfinite(np.stack([values, against, *others])).all(axis=0)
        if np.count_nonzero(known) < 2 * _SAMPLES:
            return 0
        basis = np.linalg.qr(np.column_stack([other[known] for other in others]))[0]
        left, pushed = (v[known] - basis @ (basis.T @ v[known]) for v in (values, against))
        length = float(np.linalg.norm(left) * np.linalg.norm(pushed))
        if np.sqrt(np.mean(left**2)) < _SHARE * np.nanstd(self._recording[channel]) or length == 0:
            return 0
        correlation = float(left @ pushed) / length
        return int(np.sign(correlation)) if abs(correlation) > _CLEAR else 0

    def _on_grid(self, channel: str) -> np.ndarray:
        time, values = self._recording.time, self._recording[channel]
        known = np.isfinite(values)
        if not known.any():
            return np.full_like(self._instants, np.nan)
        found = np.interp(self._instants, time[known], values[known])
        far = plausibility.distance(self._instants, time[known]) > self._step * _SAMPLES / 8
        return np.where(far, np.nan, found)


def _averaged(values: np.ndarray) -> np.ndarray:
    rising = np.arange(1, _SAMPLES + 1)
    kernel = np.concatenate([rising, rising[-2::-1]]) / _SAMPLES**2
    return np.convolve(values, kernel, "same")[_SAMPLES:-_SAMPLES]
