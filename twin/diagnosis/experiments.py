"""Design of an experiment that discriminates between two fitted models: realisable ones, simulated under both.

Experiments are ranked by the difference of the predictions that remains when both models are fitted to the new
recording, see `separation`. Experiments that would turn the hub too far are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import chirp

from twin import labels
from twin.diagnosis.separation import Explanation, difference
from twin.recording import ON_HUB, Recording

_ADDED_PAYLOAD = 0.5  # added mass, as a share of the payload
_DEFAULT_LIMIT = 0.2  # N m, if no torque limit is declared: that of a small servo
EXTRA_SENSORS: Mapping[str, float] = {"motor_torque": 1e-3, "tip_deflection": 2e-4, "tip_acceleration": 0.05}
"""Sensors that could be added to a rig, with an ordinary standard deviation of their noise, SI; assumed."""


@dataclass(frozen=True)
class Experiment:
    """One experiment that could be recorded.

    Attributes:
      name: short, in lower case.
      how: what to do, a phrase.
      recording: time [s] and torque_command [N m], which is zero with the hub locked.
      added_mass: added payload [kg].
    """

    name: str
    how: str
    recording: Recording = field(repr=False)
    added_mass: float = 0.0


@dataclass(frozen=True)
class Plan:
    """How well an experiment discriminates between two models after both are fitted to it.

    Attributes:
      experiment: what to record.
      separation: largest root-mean-square difference of the predictions of a channel [noise levels].
      channel: this channel.
      sensor: a sensor to add that would raise the separation by more than half, with the separation then [noise
        levels]; None if there is none.
    """

    experiment: Experiment
    separation: float
    channel: str
    sensor: tuple[str, float] | None


def possible_experiments(declared: Mapping[str, float], period: float = 2e-3) -> list[Experiment]:
    """Experiments that a rig can do: slews, sweeps, steps, ramps, decays with the hub locked, slews with more payload.

    A rig without payload gets none.

    Args:
      declared: parameters of the rig, SI.
      period: sample period [s].
    """
    declared_limit = declared.get("torque_limit", np.inf)
    limit = declared_limit if np.isfinite(declared_limit) else _DEFAULT_LIMIT / 0.93
    strong = 0.93 * limit
    gentle = max(1.3 * declared["static_friction"], 0.4 * limit)
    ramp = 1.1 * max(declared["static_friction"], 0.02 * limit)
    mass = _ADDED_PAYLOAD * declared["tip_mass"]
    slew = _slews(strong, (0.25, 0.4), period)
    loaded = Experiment(
        "slews-payload", f"the strong slews with {labels.number(1e3 * mass, 2)} g more payload", slew, mass
    )
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
        *([loaded] if mass > 0 else []),
    ]


def rank(
    first: Explanation,
    second: Explanation,
    noise: Mapping[str, float],
    pool: Executor,
    options: Sequence[Experiment] | None = None,
) -> list[Plan]:
    """Experiments by their separation of two explanations, largest first; those that turn the hub too far are left out.

    Args:
      first, second: the explanations.
      noise: channel -> standard deviation of its noise, SI: the channels that the rig has.
      pool: where the simulations run.
      options: the experiments; by default `possible_experiments` of the declared rig.
    """
    options = possible_experiments(first.model.declared) if options is None else options
    plans = pool.map(lambda e: _plan_of(first, second, noise, e), options)
    return sorted((p for p in plans if p is not None), key=lambda p: -p.separation)


def _plan_of(
    first: Explanation, second: Explanation, noise: Mapping[str, float], experiment: Experiment
) -> Plan | None:
    def usable(channels: Mapping[str, float]) -> dict[str, float]:
        return {c: s for c, s in channels.items() if not (experiment.recording.clamped and c in _NEEDS_HUB)}

    known = usable(noise)
    new = {c: s for c, s in usable(EXTRA_SENSORS).items() if c not in noise}
    predicted = difference(first, second, {**new, **known}, experiment.recording, experiment.added_mass)
    if predicted is None:
        return None
    remaining = predicted.after_refit(tuple(known))
    channel = max(remaining, key=lambda c: remaining[c], default="hub_angle")
    best = remaining.get(channel, 0.0)
    with_sensor = {c: max(predicted.after_refit((*known, c)).values()) for c in new}
    sensor = max(with_sensor, key=lambda c: with_sensor[c], default=None)
    added = (sensor, with_sensor[sensor]) if sensor is not None and with_sensor[sensor] > 1.5 * best else None
    return Plan(experiment, best, channel, added)


_NEEDS_HUB = (*ON_HUB, "motor_torque")  # channels without information if the hub is locked


# Torques


def _recording(name: str, torque: np.ndarray, period: float, **more) -> Recording:
    return Recording(name, period * np.arange(len(torque)), {"torque_command": torque}, **more)


def _slews(torque: float, halves: Sequence[float], period: float) -> Recording:
    """Bang-bang pulses with these half lengths [s], each followed by a rest; then the same in the other direction."""
    parts = [np.zeros(_samples(0.4, period))]
    for sign in (1, -1):
        for half in halves:
            parts += [_doublet(sign * torque, half, period), np.zeros(_samples(1.2, period))]
    return _recording("slews", np.concatenate(parts), period)


def _doublet(torque: float, half: float, period: float) -> np.ndarray:
    count = _samples(half, period)
    return torque * np.r_[np.ones(count), -np.ones(count)]


def _sweep(torque: float, start: float, end: float, duration: float, period: float) -> Recording:
    """A cosine of rising frequency: the integral of the torque has no mean, so that the hub does not drift away."""
    time = period * np.arange(_samples(duration, period))
    return _recording("sweep", torque * chirp(time, start, duration, end, "logarithmic"), period)


def _doublets(torque: float, duration: float, period: float) -> Recording:
    """Pairs of opposite steps, in alternating directions, so that the hub does not drift away."""
    random, parts, length, sign = np.random.default_rng(0), [], 0, 1
    while length < _samples(duration, period):
        parts.append(_doublet(sign * torque * random.uniform(0.4, 1.0), random.uniform(0.05, 0.3), period))
        length, sign = length + len(parts[-1]), -sign
    return _recording("random-doublets", np.concatenate(parts), period)


def _ramp(torque: float, duration: float, period: float) -> Recording:
    """A ramp over three quarters of the duration, then zero torque, in which the hub comes to rest."""
    count = _samples(0.75 * duration, period)
    rest = np.zeros(_samples(0.25 * duration, period))
    return _recording("ramp", np.r_[np.linspace(0.0, torque, count), rest], period)


def _decay(deflection: float, duration: float, period: float) -> Recording:
    still = np.zeros(_samples(duration, period))
    return _recording("decay", still, period, clamped=True, initial_tip_deflection=deflection)


def _samples(duration: float, period: float) -> int:
    return int(round(duration / period))


def recommendation(plans: Sequence[Plan], names: Sequence[str]) -> str:
    """The best experiment with its separation, as a sentence or two."""
    best = plans[0]
    pair, apart = " and ".join(names), labels.ratio(best.separation)
    if best.separation < 3:
        text = f"No experiment of the planner separates {pair} by more than {apart} noise levels."
    else:
        text = (
            f"To tell {pair} apart, record {best.experiment.how} ({best.experiment.name}): "
            f"{best.channel} differs by {apart} noise levels"
            f"{_runner_up(plans)}."
        )
    sensors = [(p.sensor[1], p.sensor[0], p.experiment.name) for p in plans if p.sensor]
    if sensors and max(sensors)[0] > 1.5 * best.separation:
        separation, channel, name = max(sensors)
        more = labels.ratio(separation)
        text += f" With a sensor of {channel} added, {name} would separate them by {more} noise levels."
    return text


def _runner_up(plans: Sequence[Plan]) -> str:
    if len(plans) < 2:
        return ""
    second = plans[1]
    return f" (next best: {second.experiment.name}, {labels.ratio(second.separation)})"


def rows(plans: Sequence[Plan]) -> Iterator[tuple[str, str, str, str, str]]:
    """Name, what to do, separation, channel and a sensor to add of each plan, in words."""
    for p in plans:
        sensor = f"{labels.channel(p.sensor[0]).label}: {labels.ratio(p.sensor[1])}" if p.sensor else ""
        channel = labels.channel(p.channel).label
        yield p.experiment.name, p.experiment.how, labels.ratio(p.separation), channel, sensor
