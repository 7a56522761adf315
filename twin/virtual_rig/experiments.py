"""The experiments of a campaign: torque profiles, closed loops, and their simulation on the rig.

They follow the paper: a torque sweep over the bending modes, bang-bang slews designed on the frictionless rigid rig, a
rising torque until motion, the free vibration of the clamped link, and two closed loops. The free vibration of the
unclamped link is available, but not in the default plan.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.signal import bilinear_zpk

from twin.virtual_rig.beam import Array, Link, deflected_shape, resting_shape
from twin.virtual_rig.plant import GRAVITY, Loop, Motion, at_rest, hub_angle, quantised, simulate
from twin.virtual_rig.rig import Rig
from twin.virtual_rig.sensors import Sensors

RAMP_RATE = 0.02  # N m/s, slow enough for a quasi-static link
RAMP_TOP = 0.12  # N m
HUB_RANGE = 2.6  # rad, of the potentiometer: a recording ends where the hub leaves it
MOVED = 0.02  # rad of motion at which the ramp of a break-away test ends

Result = TypeVar("Result")


@dataclass(frozen=True)
class Experiment:
    """Plan of one experiment."""

    name: str  # of the file, without suffix
    label: str
    role: str  # "fit" or "holdout"
    start_angle: float  # rad, of the resting hub
    commands: Array  # (samples,) [N m]; zeros where a controller computes them
    reference: Array | None = None  # (samples,) [rad], of a closed loop
    tip_deflection: float | None = None  # m, from which the tip is released; None for an undeflected start
    unclamped: bool = False  # whether the hub is free during a release, held by its friction alone
    ramps: tuple[tuple[int, int], ...] = ()  # first and last sample; a ramp is cut off where the hub moves

    @property
    def clamped(self) -> bool:
        """Whether the hub is locked."""
        return self.tip_deflection is not None and not self.unclamped


def planned_campaign(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> list[Experiment]:
    """Returns a random plan of a campaign on the declared rig, about 75 s in all."""
    # Slews for fitting, and others to be predicted.
    seen = generator.choice([30, 45, 60, 75, 90], size=2, replace=False)
    unseen = generator.choice([20, 38, 52, 68, 82, 105], size=1)
    rich = multisine if generator.random() < 0.5 else random_steps
    closed = sinus if generator.random() < 0.5 else step
    return [
        torque_sweep(rig, sensors, generator),
        rich(rig, sensors, generator),
        *(bang_bang(rig, sensors, generator, float(angle)) for angle in np.sort(seen)),
        free_vibration(rig, sensors, generator),
        break_away(rig, sensors, generator),
        *(bang_bang(rig, sensors, generator, float(angle), role="holdout") for angle in unseen),
        closed(rig, sensors, generator),
    ]


def torque_sweep(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """A torque sweep over 0.5 to 30 Hz in 15 s, which contains the first two bending modes.

    It starts as a cosine, so that the hub oscillates about its initial angle instead of drifting.
    """
    t = _times(sensors, 16.0)
    age = np.clip(t - 0.5, 0.0, 15.0)
    phase = 2 * np.pi * (0.5 * age + (30.0 - 0.5) / (2 * 15.0) * age**2)
    torque = generator.uniform(0.12, 0.16) * np.cos(phase) * _taper(age, 15.0)
    return _open_loop("torque-sweep", torque, sensors, generator)


def multisine(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """Forty sines of random phase between 0.5 and 25 Hz, with a peak of 0.2 N m."""
    t = _times(sensors, 12.0)
    age = np.clip(t - 0.5, 0.0, 10.5)
    frequencies = np.geomspace(0.5, 25.0, 40)
    phases = generator.uniform(0, 2 * np.pi, len(frequencies))
    torque = np.sin(2 * np.pi * frequencies * age[:, None] + phases).sum(axis=1) * _taper(age, 10.5)
    return _open_loop("multisine", 0.2 * torque / np.abs(torque).max(), sensors, generator)


def random_steps(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """Pairs of opposite torque pulses of random height and length, with pauses between them."""
    t = _times(sensors, 10.0)
    torque = np.zeros(len(t))
    at = 0.4
    sign = generator.choice([-1, 1])
    while at < 8.5:
        length = generator.uniform(0.08, 0.3)
        height = sign * generator.uniform(0.08, 0.2)
        torque[(t >= at) & (t < at + length)] = height
        torque[(t >= at + length) & (t < at + 2 * length)] = -height
        at += 3 * length
        sign = -sign if generator.random() < 0.7 else sign
    return _open_loop("random-steps", torque, sensors, generator)


def bang_bang(
    rig: Rig, sensors: Sensors, generator: np.random.Generator, degrees: float, role: str = "fit"
) -> Experiment:
    """A slew by two opposite torque pulses, and another one back, designed on the frictionless rigid rig.

    phi = A T^2/J for pulses of height A and length T.
    """
    t = _times(sensors, 8.0)
    sign = generator.choice([-1.0, 1.0])
    torque = np.zeros(len(t))
    for start, direction in ((0.4, sign), (generator.uniform(3.5, 4.5), -sign)):
        height = generator.uniform(0.1, 0.185)
        length = math.sqrt(math.radians(degrees) * rigid_inertia(rig) / height)
        torque[(t >= start) & (t < start + length)] = direction * height
        torque[(t >= start + length) & (t < start + 2 * length)] = -direction * height
    plan = _open_loop("bang-bang", torque, sensors, generator)
    centred = plan.start_angle / 2 - sign * math.radians(degrees) / 2
    return replace(plan, name=f"bang-bang-{degrees:.0f}", role=role, start_angle=centred)


def free_vibration(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """Free vibration of the clamped link, its tip released from 30 mm."""
    plan = _open_loop("free-vibration", np.zeros(len(_times(sensors, 10.0))), sensors, generator)
    return replace(plan, start_angle=0.0, tip_deflection=0.03)


def free_release(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """Free vibration of the unclamped link, its tip released from 30 mm; the hub turns until friction stops it."""
    plan = free_vibration(rig, sensors, generator)
    return replace(plan, name="free-release", label="free-release", unclamped=True)


def break_away(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """A slowly rising torque until the hub moves, in both directions."""
    t = _times(sensors, 14.0)
    sign = generator.choice([-1.0, 1.0])
    length = RAMP_TOP / RAMP_RATE
    torque = np.zeros(len(t))
    ramps = []
    for start, direction in ((0.4, sign), (7.0, -sign)):
        inside = (t >= start) & (t < start + length)
        torque[inside] = direction * RAMP_RATE * (t[inside] - start)
        ramps.append((int(np.argmax(inside)), int(np.argmax(inside) + inside.sum())))
    plan = _open_loop("break-away", torque, sensors, generator)
    return replace(plan, label="torque-ramp", ramps=tuple(ramps))


def sinus(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """The hub follows 40 deg sinusoids at 0.2 or 0.4 Hz."""
    t = _times(sensors, 9.0)
    start = generator.uniform(-0.4, 0.4)
    swing = math.radians(40.0) * generator.choice([-1, 1])
    age = np.maximum(t - 0.5, 0.0)
    reference = start + swing * np.sin(2 * np.pi * generator.choice([0.2, 0.4]) * age)
    return Experiment("sinus-40", "closed-loop-sinus", "holdout", start, np.zeros(len(t)), reference)


def step(rig: Rig, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """The hub follows a step of 120 deg, filtered by 1/(1 + s/3)^2."""
    t = _times(sensors, 8.0)
    sign = generator.choice([-1.0, 1.0])
    start = -sign * math.radians(60.0) + generator.uniform(-0.1, 0.1)
    age = 3.0 * np.maximum(t - 0.5, 0.0)
    reference = start + sign * math.radians(120.0) * (1 - (1 + age) * np.exp(-age))
    return Experiment("step-120", "closed-loop-step", "holdout", start, np.zeros(len(t)), reference)


def rigid_inertia(rig: Rig) -> float:
    """Returns J = J0 + rho l^3/3 + mp l^2 + Jp, the inertia of the straight rig about the hub axis [kg m^2]."""
    link = rig.linear_density * rig.length**3 / 3
    return rig.hub_inertia + link + rig.tip_mass * rig.length**2 + rig.tip_inertia


def compensator(sample_rate: float) -> Array:
    """Returns b0, b1, b2, a1, a2 of the paper's compensator by the bilinear transform.

    R(s) = 5 (s + 1)/((s + 5)(s + 300)), from the error in degrees to N m.
    """
    z, p, k = bilinear_zpk([-1.0], [-5.0, -300.0], 5.0, fs=sample_rate)
    return np.append(k * np.poly(z).real, np.poly(p).real[1:])


def run_experiment(
    rig: Rig, link: Link, sensors: Sensors, plan: Experiment, times: Array, hub_noise: Array
) -> Motion:
    """Returns the motion of the rig in one experiment, sampled at `times` (samples,) [s].

    Args:
        rig: The true rig.
        link: Its discretised link.
        sensors: The data acquisition, whose readings a controller gets.
        plan: The experiment.
        times: Sample times [s].
        hub_noise: Noise of the hub sensor (samples,) [rad] in the readings of a controller.
    """
    start = _initial_state(rig, link, plan)

    def simulated(times: Array, commands: Array, loop: Loop | None) -> Motion:
        return simulate(rig, link, start, times, commands, clamped=plan.clamped, loop=loop)

    def angle(motion: Motion) -> Array:
        return hub_angle(rig, link, motion.states)

    return conducted(sensors, plan, times, hub_noise, simulated, angle)


def conducted(
    sensors: Sensors,
    plan: Experiment,
    times: Array,
    hub_noise: Array,
    simulated: Callable[[Array, Array, Loop | None], Result],
    angle: Callable[[Result], Array],
) -> Result:
    """Returns what an engine simulates in one experiment, see `run_experiment`.

    Args:
        sensors: The data acquisition.
        plan: The experiment.
        times: Sample times (samples,) [s].
        hub_noise: Noise of the hub sensor (samples,) [rad].
        simulated: The engine, from sample times, commands [N m] and controller, at the plan's initial state.
        angle: The hub angle (samples,) [rad] of what the engine returns.
    """
    if plan.reference is None:
        commands = plan.commands
        for first, last in plan.ramps:
            tried = angle(simulated(times[:last], commands[:last], None))
            commands = _cut_ramp(tried, commands, first, last)
        return simulated(times, commands, None)
    loop = Loop(
        True,
        compensator(sensors.sample_rate),
        plan.reference,
        hub_noise,
        sensors.hub_step,
        sensors.torque_step,
    )
    return simulated(times, plan.commands, loop)


def _initial_state(rig: Rig, link: Link, plan: Experiment) -> Array:
    """Returns the state at rest from which the experiment starts."""
    if plan.tip_deflection is not None:
        shape = deflected_shape(rig, link, plan.tip_deflection)
    else:
        shape = resting_shape(rig, link, plan.start_angle, GRAVITY * math.sin(rig.tilt))
    return at_rest(rig, link, plan.start_angle, shape)


def _cut_ramp(angle: Array, commands: Array, first: int, last: int) -> Array:
    """Returns the commands with the ramp between two samples cut off where the hub, at `angle` [rad], has moved."""
    moved = np.abs(angle[first:] - angle[first]) > MOVED
    result = commands.copy()
    if moved.any():
        result[first + int(np.argmax(moved)) : last] = 0.0
    return result


def _open_loop(name: str, torque: Array, sensors: Sensors, generator: np.random.Generator) -> Experiment:
    """Returns an open-loop experiment from a random hub angle, its torque quantised by the output card."""
    commands = quantised(torque, sensors.torque_step)
    return Experiment(name, name, "fit", generator.uniform(-0.6, 0.6), np.asarray(commands))


def _times(sensors: Sensors, duration: float) -> Array:
    """Returns the nominal sample times [s]."""
    return np.arange(round(duration * sensors.sample_rate)) / sensors.sample_rate


def _taper(age: Array, duration: float) -> Array:
    """Returns a window that rises from 0 to 1 in the first 0.5 s and falls to 0 in the last 0.3 s."""
    return np.clip(age / 0.5, 0.0, 1.0) * np.clip((duration - age) / 0.3, 0.0, 1.0)
