"""Commands of a bench: square waves, a pseudo-random binary sequence, stairs, three levels, steps under feedback."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.signal import bilinear, lfilter

from twin.virtual_rig.beam import Array
from twin.virtual_rig.experiments import rigid_inertia
from twin.virtual_rig.plant import quantised
from twin.virtual_rig.rig import Rig

Role = Literal["fit", "holdout"]

VOLTAGE_STEP = 1e-4  # V, of the commands
_BIT = 0.2  # s, of the pseudo-random binary sequence
_STAIR = 0.5  # s
_FILTER = 0.01  # s, of the derivative in the controller
_AMPLITUDES = {"a": (0.25, 0.35), "b": (0.4, 0.5), "c": (0.15, 0.25), "d": (0.3, 0.45), "e": (0.25, 0.45)}
"""Ranges of the amplitudes of steps under feedback [rad]; the last one is held out."""
_SMOOTHING = 0.05  # s, time constant of the reference, without which its steps would command some 100 V


@dataclass(frozen=True)
class Run:
    """Plan of one recording.

    Attributes:
        name: Of the file, without suffix.
        role: "fit" or "holdout".
        start_angle: Of the resting hub before the command begins [rad].
        volts: Commands (samples,) [V]; zeros where a controller computes them.
        lead: Samples before the recording begins; 0 for a rig at rest.
        reference: (samples,) [rad], of a closed loop, else None.
    """

    name: str
    role: Role
    start_angle: float
    volts: Array
    lead: int
    reference: Array | None = None


@dataclass(frozen=True)
class Desk:
    """What commands are designed with: a person tunes them until the rig swings as wanted."""

    rig: Rig  # with its effects
    torque_per_volt: float  # N m/V
    sample_rate: float  # Hz
    duration: float  # s, of a recording

    def volts_for(self, swing: float, half_period: float) -> float:
        """Returns the voltage of a square wave that makes the rigid rig swing so far [rad] about, to 0.05 V.

        It breaks the hub away in any case.
        """
        rig = self.rig
        torque = rig.coulomb_positive + rig.dead_zone + 0.5 * rig.friction_ripple
        torque += (rig.viscous_friction / half_period + rig.cable_stiffness / 2) * swing
        torque += 4 * rigid_inertia(rig) * swing / half_period**2
        moving = max(1.2 * self.holding_torque, torque)
        return max(round(moving / self.torque_per_volt / 0.05), 2) * 0.05

    @property
    def holding_torque(self) -> float:
        """Largest command under which the hub rests [N m]."""
        return max(
            self.rig.static_positive + self.rig.dead_zone + self.rig.friction_ripple, self.rig.dead_band
        )

    def times(self, lead: float) -> Array:
        """Returns the sample times of a run (samples,) [s]."""
        return np.arange(round((lead + self.duration) * self.sample_rate)) / self.sample_rate


def open_loop_runs(desk: Desk, generator: np.random.Generator) -> list[Run]:
    """Returns four runs to fit and two held-out ones under voltages that no controller computes."""
    short, long, other = (
        generator.uniform(0.45, 0.7),
        generator.uniform(0.8, 1.1),
        generator.uniform(0.6, 0.95),
    )
    swings = generator.uniform(0.4, 1.2, size=4)
    return [
        square(desk, "square-a", "fit", short, swings[0], generator),
        square(desk, "square-b", "fit", long, swings[1], generator),
        prbs(desk, generator),
        stairs(desk, generator),
        three_levels(desk, "three-level", "holdout", short, swings[2], generator),
        square(desk, "square-c", "holdout", other, swings[3], generator),
    ]


def closed_loop_runs(desk: Desk, generator: np.random.Generator) -> list[Run]:
    """Returns four runs under feedback to fit, another one and an open-loop square wave to be held out."""
    amplitudes = {letter: generator.uniform(*limits) for letter, limits in _AMPLITUDES.items()}
    steps = [
        reference_steps(desk, f"step-{letter}", "holdout" if letter == "e" else "fit", amplitude, generator)
        for letter, amplitude in amplitudes.items()
    ]
    half, swing = generator.uniform(0.6, 1.0), generator.uniform(0.4, 0.8)
    return [*steps, square(desk, "square-f", "holdout", half, swing, generator)]


def square(
    desk: Desk,
    name: str,
    role: Role,
    half_period: float,
    swing: float,
    generator: np.random.Generator,
) -> Run:
    """A square wave, begun with half a pulse so that the hub swings to and fro."""
    lead = generator.uniform(1.0, 3.0)
    turns = np.floor(desk.times(lead) / half_period + 0.5)
    sign = generator.choice([-1, 1]) * np.where(turns % 2 == 0, 1.0, -1.0)
    return _run(desk, name, role, desk.volts_for(swing, half_period) * sign, lead, generator)


def prbs(desk: Desk, generator: np.random.Generator) -> Run:
    """A voltage that changes its sign at random multiples of 0.2 s."""
    lead = generator.uniform(1.0, 3.0)
    bits = np.floor(desk.times(lead) / _BIT + 1e-9).astype(int)
    signs = generator.choice([-1.0, 1.0], size=bits[-1] + 1)
    return _run(desk, "prbs", "fit", desk.volts_for(0.5, 2.5 * _BIT) * signs[bits], lead, generator)


def three_levels(
    desk: Desk,
    name: str,
    role: Role,
    length: float,
    swing: float,
    generator: np.random.Generator,
) -> Run:
    """Pulses of changing sign, with pauses of their length between them."""
    lead = generator.uniform(1.0, 3.0)
    turns = np.floor(desk.times(lead) / length).astype(int) % 4
    levels = generator.choice([-1, 1]) * np.array([0.0, -1.0, 0.0, 1.0])[turns]
    return _run(desk, name, role, desk.volts_for(swing, length) * levels, lead, generator)


def stairs(desk: Desk, generator: np.random.Generator) -> Run:
    """From rest, a voltage that rises in steps to about twice that of the break-away."""
    times = desk.times(0.0)
    top = 2.0 * desk.holding_torque / desk.torque_per_volt
    treads = np.floor(np.maximum(times - 1.0, -_STAIR) / _STAIR + 1e-9) + 1
    height = round(top / treads[-1], 3) * generator.choice([-1, 1])
    return _run(desk, "stairs", "fit", height * treads, 0.0, generator)


def reference_steps(
    desk: Desk, name: str, role: Role, amplitude: float, generator: np.random.Generator
) -> Run:
    """Smoothed steps of the hub's reference from one side to the other."""
    lead = generator.uniform(1.5, 4.0)
    half_period = generator.uniform(1.3, 2.5)
    turns = np.floor(desk.times(lead) / half_period)
    steps = amplitude * generator.choice([-1, 1]) * np.where(turns % 2 == 0, 1.0, -1.0)
    decay = math.exp(-1 / (_SMOOTHING * desk.sample_rate))
    reference = np.asarray(lfilter([1 - decay], [1, -decay], steps))
    run = _run(desk, name, role, np.zeros(len(reference)), lead, generator)
    return replace(run, start_angle=0.0, reference=reference)


def drawn_controller(desk: Desk, generator: np.random.Generator) -> Array:
    """Returns b0, b1, b2, a1, a2 of a proportional controller with filtered derivative, from degrees to N m."""
    gain = desk.torque_per_volt * generator.uniform(15.0, 45.0)  # N m/rad
    damping = 2 * generator.uniform(0.3, 0.5) * math.sqrt(gain * rigid_inertia(desk.rig))
    b, a = bilinear([gain * _FILTER + damping, gain], [_FILTER, 1.0], fs=desk.sample_rate)
    return np.array([*np.radians(b), 0.0, a[1], 0.0])


def _run(
    desk: Desk,
    name: str,
    role: Role,
    volts: Array,
    lead: float,
    generator: np.random.Generator,
) -> Run:
    """Returns an open-loop run from a random hub angle."""
    angle = generator.uniform(-0.15, 0.15)
    return Run(name, role, angle, np.asarray(quantised(volts, VOLTAGE_STEP)), round(lead * desk.sample_rate))
