"""Which experiment would tell two explanations apart: realisable ones, simulated under both.

How far two are apart on a run is what is left of their difference when both are fitted to it: see `separation`. Runs
that would wind the wires around the hub are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import chirp

from twin.diagnosis.separation import Explanation, difference
from twin.recording import Recording

_PAYLOAD = 0.5  # share of the payload that is added
_OPEN_LIMIT = 0.2  # N m, where the amplifier has no limit: that of a small servo
EXTRA_SENSORS: Mapping[str, float] = {"motor_torque": 1e-3, "tip_deflection": 2e-4, "tip_acceleration": 0.05}
"""Channels that a rig may be given, with the noise of an ordinary sensor, SI; assumed."""


@dataclass(frozen=True)
class Experiment:
    """One experiment that could be recorded.

    Attributes:
      name: for people, and of its file.
      how: what to do, a sentence.
      recording: time [s] and torque_command [N m]; a locked hub has none that acts.
      added_mass: payload added [kg].
    """

    name: str
    how: str
    recording: Recording = field(repr=False)
    added_mass: float = 0.0


@dataclass(frozen=True)
class Plan:
    """How well an experiment separates two explanations, once both are fitted to it.

    Attributes:
      experiment: what to record.
      separation: largest RMS difference of a channel that the rig has [noise levels].
      channel: that channel.
      sensor: channel to add that would separate better, with the largest difference of any channel then
        [noise levels]; None where none would.
    """

    experiment: Experiment
    separation: float
    channel: str
    sensor: tuple[str, float] | None


def experiments(declared: Mapping[str, float], period: float = 2e-3) -> list[Experiment]:
    """Returns experiments that a rig like this can do: slews, sweeps, steps, ramps, a locked decay, a payload added.

    Args:
      declared: parameters of the rig, SI.
      period: sample period [s].
    """
    limit = min(declared.get("torque_limit", np.inf), _OPEN_LIMIT / 0.93)
    strong = 0.93 * limit
    gentle = max(1.3 * declared["static_friction"], 0.4 * limit)
    ramp = 1.1 * max(declared["static_friction"], 0.02 * limit)
    mass = _PAYLOAD * declared["tip_mass"]
    slew = _slews(strong, (0.25, 0.4), period)
    return [
        Experiment("slews", "strong bang-bang slews of two lengths, there and back", slew),
        Experiment(
            "far-slew",
            "a long bang-bang slew, and back",
            _slews(strong, (0.55,), period),
        ),
        Experiment("gentle-slews", "slews just above break-away", _slews(gentle, (0.4, 0.6), period)),
        Experiment("sweep", "a torque sweep from 1 to 30 Hz", _sweep(strong, 1.0, 30.0, 20.0, period)),
        Experiment("slow-sweep", "a torque sweep from 0.6 to 4 Hz", _sweep(strong, 0.6, 4.0, 20.0, period)),
        Experiment(
            "random-doublets",
            "pairs of torque steps of random height and length",
            _doublets(strong, 15.0, period),
        ),
        Experiment("ramp", "a slow torque ramp past break-away", _ramp(ramp, 4.0, period)),
        Experiment("ramp-back", "a slow torque ramp past break-away, backwards", _ramp(-ramp, 4.0, period)),
        Experiment("small-decay", "hub locked, tip released from 10 mm", _decay(0.01, 10.0, period)),
        Experiment("large-decay", "hub locked, tip released from 60 mm", _decay(0.06, 10.0, period)),
        Experiment("slews-payload", f"the strong slews with {1e3 * mass:.0f} g more payload", slew, mass),
    ]


def plan(
    first: Explanation,
    second: Explanation,
    noise: Mapping[str, float],
    pool: Executor,
    options: Sequence[Experiment] | None = None,
) -> list[Plan]:
    """Ranks experiments by how far they drive two explanations apart, best first; at least the locked decays are left.

    Args:
      first, second: the explanations.
      noise: channel -> standard deviation of its noise, SI: the channels that the rig has.
      pool: where the simulations run.
      options: by default `experiments` of the declared rig.
    """
    options = experiments(first.model.declared) if options is None else options
    plans = pool.map(lambda e: _planned(first, second, noise, e), options)
    return sorted((p for p in plans if p is not None), key=lambda p: -p.separation)


def _planned(
    first: Explanation, second: Explanation, noise: Mapping[str, float], experiment: Experiment
) -> Plan | None:
    def shown(channels: Mapping[str, float]) -> dict[str, float]:
        return {c: s for c, s in channels.items() if not (experiment.recording.clamped and c in _NEEDS_HUB)}

    known = shown(noise)
    new = {c: s for c, s in shown(EXTRA_SENSORS).items() if c not in noise}
    apart = difference(first, second, {**new, **known}, experiment.recording, experiment.added_mass)
    if apart is None:
        return None
    left = apart.left(tuple(known))
    channel = max(left, key=lambda c: left[c], default="hub_angle")
    best = left.get(channel, 0.0)
    beside = {c: max(apart.left((*known, c)).values()) for c in new}
    sensor = max(beside, key=lambda c: beside[c], default=None)
    added = (sensor, beside[sensor]) if sensor is not None and beside[sensor] > 1.5 * best else None
    return Plan(experiment, best, channel, added)


_NEEDS_HUB = ("hub_angle", "motor_torque")


# Torques


def _recording(name: str, torque: np.ndarray, period: float, **more) -> Recording:
    return Recording(name, period * np.arange(len(torque)), {"torque_command": torque}, **more)


def _slews(torque: float, halves: Sequence[float], period: float) -> Recording:
    """Bang-bang pulses with these half lengths [s], each followed by a rest, and all done again the other way."""
    parts = [np.zeros(_samples(0.4, period))]
    for sign in (1, -1):
        for half in halves:
            parts += [_doublet(sign * torque, half, period), np.zeros(_samples(1.2, period))]
    return _recording("slews", np.concatenate(parts), period)


def _doublet(torque: float, half: float, period: float) -> np.ndarray:
    count = _samples(half, period)
    return torque * np.r_[np.ones(count), -np.ones(count)]


def _sweep(torque: float, start: float, end: float, duration: float, period: float) -> Recording:
    """A cosine of growing frequency: its impulse has no mean, so that the hub stays near."""
    time = period * np.arange(_samples(duration, period))
    return _recording("sweep", torque * chirp(time, start, duration, end, "logarithmic"), period)


def _doublets(torque: float, duration: float, period: float) -> Recording:
    """Pairs of steps without impulse, to and fro in turns, so that the hub stays near."""
    random, parts, length, sign = np.random.default_rng(0), [], 0, 1
    while length < _samples(duration, period):
        parts.append(_doublet(sign * torque * random.uniform(0.4, 1.0), random.uniform(0.05, 0.3), period))
        length, sign = length + len(parts[-1]), -sign
    return _recording("random-doublets", np.concatenate(parts), period)


def _ramp(torque: float, duration: float, period: float) -> Recording:
    """A ramp over three quarters of the time; then nothing, so that the hub that broke away comes to rest."""
    count = _samples(0.75 * duration, period)
    rest = np.zeros(_samples(0.25 * duration, period))
    return _recording("ramp", np.r_[np.linspace(0.0, torque, count), rest], period)


def _decay(deflection: float, duration: float, period: float) -> Recording:
    still = np.zeros(_samples(duration, period))
    return _recording("decay", still, period, clamped=True, initial_tip_deflection=deflection)


def _samples(duration: float, period: float) -> int:
    return int(round(duration / period))


def recommendation(plans: Sequence[Plan], names: Sequence[str]) -> str:
    """Returns what to record, with the numbers, as a sentence or two."""
    best = plans[0]
    pair = " and ".join(names)
    if best.separation < 3:
        text = (
            f"No experiment of the planner separates {pair} by more than {best.separation:.1f} noise levels."
        )
    else:
        text = (
            f"To tell {pair} apart, record {best.experiment.name} ({best.experiment.how}): "
            f"{best.channel} differs by {best.separation:.3g} noise levels"
            f"{_runner_up(plans)}."
        )
    sensors = [(p.sensor[1], p.sensor[0], p.experiment.name) for p in plans if p.sensor]
    if sensors and max(sensors)[0] > 1.5 * best.separation:
        apart, channel, name = max(sensors)
        text += f" With a sensor of {channel} added, {name} would separate them by {apart:.3g} noise levels."
    return text


def _runner_up(plans: Sequence[Plan]) -> str:
    if len(plans) < 2:
        return ""
    second = plans[1]
    return f" (next best: {second.experiment.name}, {second.separation:.3g})"


def rows(plans: Sequence[Plan]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yields name, what to do, separation, channel and a sensor to add of each plan, as text."""
    for p in plans:
        sensor = f"{p.sensor[0]}: {p.sensor[1]:.3g}" if p.sensor else ""
        yield p.experiment.name, p.experiment.how, f"{p.separation:.3g}", p.channel, sensor
