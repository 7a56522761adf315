"""Recordings checked against the declared rig: dead sensors, copies, rigs that do not move, torque in another unit.

A recording is rejected, or a channel left out, only where it violates physics that every planar link obeys by a factor
of at least 10, so that no effect of a rig, such as friction, backlash, back-EMF or a moving payload, is mistaken for a
fault of the data.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from twin.campaigns import schema
from twin.errors import InputError
from twin.mechanics import beam
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS, ON_HUB, Recording, Sensor

# Range of a channel, in standard deviations of its noise, from which it moves: noise alone spans 8 in 50 000 samples.
_NOISE_SPAN = 12.0

# Factor from which a torque is too small for its unit: halfway, on a logarithmic scale, between 1 and 1000.
_TOO_SMALL = 30.0
# Factor from which it is too large; more, as undeclared viscous friction can balance most of a torque.
_TOO_LARGE = 50.0

_HELD, _LONG = 2.0, 0.1
"""Torque in units of the declared static friction [1], and its duration [s], that should move a hub; only a note."""

_SHAPE = ("strain_base", "strain_mid", "tip_deflection")  # channels of the link


# Frozen sensors


def without_stuck_channels(
    recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig
) -> tuple[list[Recording], list[str]]:
    """Returns the recordings, NaN in channels that never change although the rig moves, and a note on each of these.

    Each recording is judged by itself, so that held-out recordings have no influence on those that are fitted.

    Raises:
      InputError: a sensor is dead: its channel changes in no recording.
    """
    for channel in sensors:
        _refuse_dead(channel, recordings, sensors, rig)
    stuck = [[c for c in r.measured() if _is_stuck(c, r, sensors, rig)] for r in recordings]
    kept = [_with_missing(recording, channels) for recording, channels in zip(recordings, stuck, strict=True)]
    notes = [_note(r, c) for r, channels in zip(recordings, stuck, strict=True) for c in channels]
    return kept, notes


def _refuse_dead(
    channel: str, recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig
) -> None:
    present = [r for r in recordings if channel in r.measured()]
    if channel in ON_HUB:
        present = [r for r in present if not r.clamped]
    if not present or not all(_is_constant(r[channel]) for r in present):
        return
    # Strain gauges are never without noise, but a hub may rest throughout.
    may_rest = channel in (*ON_HUB, "motor_torque")
    if may_rest and not any(_is_stuck(channel, recording, sensors, rig) for recording in present):
        return
    value = _value(present[0], channel)
    files = ", ".join(recording.name for recording in present)
    raise InputError(
        f"{schema.FILE}: channels.{channel} never changes: it is {value} throughout {files}; "
        "expected a measurement: leave out a dead sensor"
    )


def _is_stuck(channel: str, recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> bool:
    if not _is_constant(recording[channel]):
        return False
    if channel == "hub_angle":
        return _hub_must_turn(recording, sensors, rig)
    if channel == "hub_rate":
        turns = "hub_angle" in recording and _exceeds_noise(recording["hub_angle"], sensors["hub_angle"])
        return not recording.clamped and turns
    if channel == "motor_torque":
        return not recording.clamped and float(np.ptp(recording["torque_command"])) > 0
    others = [c for c in ("hub_angle", *_SHAPE) if c != channel and c in recording]
    return bool(recording.initial_tip_deflection) or any(
        _exceeds_noise(recording[c], sensors[c]) for c in others
    )


def _hub_must_turn(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> bool:
    """Whether vibration of the link shows that the hub turned: from rest, nothing else can excite it.

    Under a command below the static friction nothing moves, and a constant hub angle is a valid measurement.
    """
    excited = recording.start == "unknown" or recording.initial_tip_deflection
    if recording.clamped or excited or _peak_torque(recording) <= 3 * rig["static_friction"]:
        return False
    return any(_exceeds_noise(recording[c], sensors[c]) for c in _SHAPE if c in recording)


def _with_missing(recording: Recording, channels: Sequence[str]) -> Recording:
    missing = {channel: np.full(len(recording), np.nan) for channel in channels}
    return recording.replace(channels={**recording.channels, **missing}) if missing else recording


def _note(recording: Recording, channel: str) -> str:
    value = _value(recording, channel)
    return f"{recording.name}: {channel} stays at {value} while the rig moves; taken as missing there"


def _value(recording: Recording, channel: str) -> str:
    unit = CHANNEL_UNITS[channel]
    return f"{_finite(recording[channel])[0]:g}{'' if unit == '1' else f' {unit}'}"


def _finite(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _is_constant(values: np.ndarray) -> bool:
    known = _finite(values)
    return known.size > 1 and float(np.ptp(known)) == 0.0


def _exceeds_noise(values: np.ndarray, sensor: Sensor) -> bool:
    known = _finite(values)
    return known.size > 1 and float(np.ptp(known)) > _NOISE_SPAN * _noise(known, sensor)


def _noise(known: np.ndarray, sensor: Sensor) -> float:
    """Returns the declared noise, or else a robust estimate from differences of successive samples."""
    if sensor.noise is not None:
        return sensor.noise
    return 1.4826 * float(np.median(np.abs(np.diff(known)))) / math.sqrt(2)


# Duplicate recordings


def check_distinct(recordings: Sequence[Recording]) -> None:
    """Makes sure that no recording is a copy of another, as a copy of a fitted recording would pass for a prediction.

    Raises:
      InputError: two recordings hold the same samples.
    """
    for first, second in combinations(recordings, 2):
        if _same_samples(first, second):
            raise InputError(
                f"{second.name} holds the same samples as {first.name}; expected each recording once in {schema.FILE}"
            )


def _same_samples(first: Recording, second: Recording) -> bool:
    channels = first.measured()
    return channels == second.measured() and all(
        np.array_equal(first[c], second[c], equal_nan=True) for c in channels
    )


# Rigs that do not move


def check_motion(fit: Sequence[Recording], sensors: Mapping[str, Sensor]) -> None:
    """Makes sure that there is something to fit.

    Raises:
      InputError: neither hub nor link moves in any of these recordings.
    """
    if not any(
        _exceeds_noise(r[c], sensors[c]) for r in fit for c in ("hub_angle", *_SHAPE) if c in r.measured()
    ):
        files = ", ".join(recording.name for recording in fit)
        raise InputError(
            f"nothing moves in {files}: every channel stays within {_NOISE_SPAN:g} times its noise; expected "
            "recordings of a rig that moves"
        )


def immobile_hub_notes(recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig) -> list[str]:
    """Returns a note for each recording whose hub rests under a torque that should have moved it."""
    return [note for r in recordings if (note := _immobile_hub_note(r, sensors, rig))]


def _immobile_hub_note(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> str:
    static = rig["static_friction"]
    if recording.clamped or "hub_angle" not in recording.measured() or static <= 0:
        return ""
    torque = _sustained_torque(recording)
    if _exceeds_noise(recording["hub_angle"], sensors["hub_angle"]) or torque < _HELD * static:
        return ""
    return (
        f"{recording.name}: the hub rests throughout though {torque:.3g} N*m are commanded for {_LONG:g} s, "
        f"{torque / static:.1f} times the declared static friction. Was the drive on, and its coupling tight? "
        "Such a recording says nothing of what is missing"
    )


def _sustained_torque(recording: Recording) -> float:
    """Returns the largest torque of one sign that is commanded for at least `_LONG` [N m]."""
    samples = max(1, round(_LONG / recording.period))
    torque = recording["torque_command"]
    lowest, highest = minimum_filter1d(torque, samples), maximum_filter1d(torque, samples)
    return float(max(lowest.max(), -highest.min(), 0.0))


# Torque in another unit than declared


def check_torque(recordings: Sequence[Recording], sensors: Mapping[str, Sensor], rig: Rig) -> None:
    """Checks the unit of the command against the amplifier's limit, the declared friction and the motion.

    The angular momentum about the hub axis changes by the torque alone, however the link bends: an acceleration a takes
    at least the torque J a, J being the inertia of the rig with a straight link.

    Raises:
      InputError: the command cannot be in the declared unit; a factor of 1000 is recognised, one of 3 is not.
    """
    for recording in recordings:
        for complaint in _torque_errors(recording, sensors, rig):
            raise InputError(
                f"{schema.FILE}: channels.torque_command.unit: in {recording.name} the command {complaint}; "
                "expected N*m at the hub: check the unit or the gain"
            )


def _torque_errors(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> Iterator[str]:
    peak, limit = _peak_torque(recording), rig["torque_limit"]
    if peak > _TOO_LARGE * limit > 0:
        yield f"peaks at {peak:.3g} N*m, {peak / limit:.0f} times the torque_limit of {limit:.3g} N*m"
    if recording.clamped or "hub_angle" not in recording:
        return
    if not _exceeds_noise(recording["hub_angle"], sensors["hub_angle"]):
        return
    command = recording["torque_command"]
    given = np.clip(command, -limit, limit) if limit > 0 else command  # what the amplifier gives
    rms = float(np.sqrt(np.mean(given**2)))
    shown = _largest_torque_shown(recording, sensors, rig)
    if rms > _TOO_LARGE * shown > 0:
        yield f"is {rms:.3g} N*m rms, where motion, bending and declared friction show {shown:.3g} N*m at most"
    needed = _least_torque_needed(recording, sensors, rig)
    if needed > _TOO_SMALL * peak:
        yield f"peaks at {peak:.3g} N*m, where the motion of hub_angle takes {needed:.3g} N*m at least"


def _largest_torque_shown(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> float:
    """Returns the largest torque that acceleration, bending moment or declared friction indicate [N m]."""
    period = vibration_period(recording, rig)
    signs = [rig["static_friction"], rig["coulomb_friction"]]
    for span in (2 * period, 4 * period):
        before, after = _successive_turns(recording, span)
        if before.size:
            signs.append(beam.rigid_inertia(rig) * float(np.max(np.abs(after - before))) / span**2)
    for channel in ("strain_base", "strain_mid"):
        if channel in recording and (known := _finite(recording[channel])).size:
            strain = float(np.max(np.abs(known - np.median(known))))
            signs.append(rig["bending_stiffness"] * strain / sensors[channel].half_thickness)
    return max(signs)


def _least_torque_needed(recording: Recording, sensors: Mapping[str, Sensor], rig: Rig) -> float:
    """Returns the least torque that explains the acceleration of the hub, and its break-away [N m]."""
    if recording.initial_tip_deflection:
        return 0.0  # the released link turns the hub
    known = _finite(recording["hub_angle"])
    sigma = max(_noise(known, sensors["hub_angle"]), _resolution(known))
    # Over four periods of the first mode the vibration of the hub averages out.
    span = 4 * vibration_period(recording, rig)
    before, after = _successive_turns(recording, span)
    gain = np.abs(after) - np.abs(before)
    speeding = float(np.max(gain, initial=0.0)) - _NOISE_SPAN * math.sqrt(6) * sigma
    if speeding <= 0:
        return 0.0
    leaving = rig["static_friction"] if recording.start == "rest" else 0.0
    return max(beam.rigid_inertia(rig) * speeding / span**2, leaving)


def _successive_turns(recording: Recording, span: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the rotations of the hub in pairs of successive spans (m each) [rad]; those near gaps are omitted."""
    time, angle = recording.time, recording["hub_angle"]
    known = np.isfinite(angle)
    middle = np.arange(time[0] + span, time[-1] - span, span / 8)
    instants = np.add.outer((-span, 0.0, span), middle)
    values = np.interp(instants, time[known], angle[known])
    near = distance_to_nearest(instants, time[known]) <= span / 8
    a, b, c = values[:, near.all(axis=0)]
    return b - a, c - b


def distance_to_nearest(instants: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Returns the distance of each instant from the nearest of the samples, which are ascending [s]."""
    after = np.clip(np.searchsorted(samples, instants), 1, len(samples) - 1)
    return np.minimum(np.abs(instants - samples[after - 1]), np.abs(samples[after] - instants))


def _resolution(known: np.ndarray) -> float:
    """Smallest change between successive readings; 0 where none changes."""
    changes = np.abs(np.diff(known))
    return float(np.min(changes[changes > 0], initial=np.inf)) if (changes > 0).any() else 0.0


def _peak_torque(recording: Recording) -> float:
    return float(np.max(np.abs(recording["torque_command"])))


def vibration_period(recording: Recording, rig: Rig) -> float:
    """Returns an estimate of the period of the first free mode [s], but at least two samples."""
    # Windows shorter than that would only be more numerous.
    return max(1 / _first_frequency(rig), 2 * recording.period)


def _first_frequency(rig: Rig) -> float:
    """Returns an estimate of the first free frequency [Hz]: a mass on a massless beam, on a hub with inertia.

    The beam's own mass counts as 33/140 of it at the tip (Rayleigh); the free hub raises the frequency.
    """
    mass = rig["tip_mass"] + 33 / 140 * rig["linear_density"] * rig["length"]
    locked = math.sqrt(3 * rig["bending_stiffness"] / rig["length"] ** 3 / mass) / (2 * math.pi)
    return locked * math.sqrt(1 + mass * rig["length"] ** 2 / rig["hub_inertia"])
