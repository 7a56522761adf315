"""Runs of a bench on the plant, what an effect changes in them, and how far the plant repeats them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.virtual_rig.beam import Array, Link, build_link
from twin.virtual_rig.bench.commands import VOLTAGE_STEP, Run
from twin.virtual_rig.bench.kinds import Effects
from twin.virtual_rig.bench.sensors import BenchSensors, raw_readings, true_readings
from twin.virtual_rig.effects import switch_on
from twin.virtual_rig.plant import Loop, at_rest, coordinates, hub_angle, simulate
from twin.virtual_rig.rig import Rig

BREAK_AWAY_CHANGE = 1e-3
"""Relative change of the static friction under which a run is repeated."""
_TRAVEL = 6.0  # rad from the first reading: about a turn, where somebody stops the rig
_WINDOW = 1.0  # s, within which an effect has to show


@dataclass(frozen=True)
class Bench:
    """A rig with undeclared effects, its sensors and its controller.

    Attributes:
        base: The rig without the effects.
        effects: The undeclared effects by name.
        torque_per_volt: Of the drive [N m/V].
        sensors: The data acquisition.
        controller: (5,) coefficients of the recurrence of `plant.Loop`.
    """

    base: Rig
    effects: Effects
    torque_per_volt: float
    sensors: BenchSensors
    controller: Array

    @property
    def rig(self) -> Rig:
        """The rig with its effects."""
        return switch_on(self.base, self.effects)

    def rig_without(self, name: str) -> Rig:
        """Returns the rig with its other effects."""
        return switch_on(self.base, {k: v for k, v in self.effects.items() if k != name})


@dataclass(frozen=True)
class Recorded:
    """A run on the plant, from the first sample of its recording to the last.

    Attributes:
        run: Its plan.
        rig, link: The rig of this run, and its discretised link.
        commands: (samples,) [N m].
        true: Readings by channel without noise and zero (samples,), SI.
        states: (samples x 2 nz) at the sample times.
        columns: Those of its file by name.
    """

    run: Run
    rig: Rig
    link: Link
    commands: Array
    true: Mapping[str, Array]
    states: Array
    columns: Mapping[str, Array]

    @property
    def completeness(self) -> float:
        """Share of the planned samples before the hub has travelled too far."""
        return len(self.commands) / (len(self.run.volts) - self.run.lead)


def record(bench: Bench, run: Run, generator: np.random.Generator) -> Recorded:
    """Returns one run on the rig with its effects."""
    rig = bench.rig._replace(knock_phase=generator.uniform(0.0, 2 * np.pi))
    link, sensors = build_link(rig), bench.sensors
    times = np.arange(len(run.volts)) / sensors.sample_rate
    start = at_rest(rig, link, run.start_angle, np.zeros(len(link.stiffness)))
    hub_noise = sensors.hub_noise * generator.standard_normal(len(times))
    planned = bench.torque_per_volt * run.volts
    motion = simulate(rig, link, start, times, planned, loop=_loop(bench, run, hub_noise))
    true = true_readings(rig, link, sensors, motion.states)
    columns = {
        "motor_voltage": motion.commands / bench.torque_per_volt,
        **raw_readings(sensors, true, hub_noise, generator),
    }
    # States at the sample times, which a late sensor reads only afterwards.
    states = motion.states
    if rig.sensor_delay:
        states = simulate(rig._replace(sensor_delay=0.0), link, start, times, motion.commands).states
    kept = _kept(run, hub_angle(rig, link, states))
    return Recorded(
        run,
        rig,
        link,
        motion.commands[kept],
        {channel: values[kept] for channel, values in true.items()},
        states[kept],
        {"time": times[: kept.stop - kept.start], **{name: values[kept] for name, values in columns.items()}},
    )


def visibility(bench: Bench, recorded: Recorded, name: str) -> float:
    """Returns the largest RMS change of a channel that an effect makes in windows of 1 s, in noise levels.

    In each window the rig without the effect starts in the state of the one with it. What depends on time begins anew.
    """
    rig = bench.rig_without(name)._replace(knock_phase=recorded.rig.knock_phase)
    link = build_link(rig)
    samples = round(_WINDOW * bench.sensors.sample_rate)
    firsts = range(0, len(recorded.commands) - samples + 1, samples)
    changes = []
    for first in firsts:
        start = _mapped(recorded, rig, link, recorded.states[first])
        run = _rerun(bench, rig, link, start, recorded.commands[first : first + samples])
        changes.append({c: run[c] - recorded.true[c][first : first + samples] for c in run})
    noise = bench.sensors.noise_levels()
    return max(_rms(np.concatenate([change[c] for change in changes])) / noise[c] for c in noise)


def repeatability(bench: Bench, recorded: Recorded) -> dict[str, float]:
    """Returns by channel how far the plant repeats a recording from its first sample: RMS change, SI.

    It is that by a static friction smaller or larger by `BREAK_AWAY_CHANGE`.
    """
    found = dict.fromkeys(recorded.true, 0.0)
    for share in (1 - BREAK_AWAY_CHANGE, 1 + BREAK_AWAY_CHANGE):
        runs = [
            _rerun(bench, rig, recorded.link, recorded.states[0], recorded.commands)
            for rig in (recorded.rig, _with_static_friction(recorded.rig, share))
        ]
        found = {c: max(found[c], _rms(runs[1][c] - runs[0][c])) for c in found}
    return found


def _with_static_friction(rig: Rig, share: float) -> Rig:
    return rig._replace(
        static_positive=share * rig.static_positive, static_negative=share * rig.static_negative
    )


def _rerun(bench: Bench, rig: Rig, link: Link, start: Array, commands: Array) -> dict[str, Array]:
    """Returns the readings without noise of given commands from a state."""
    times = np.arange(len(commands)) / bench.sensors.sample_rate
    return true_readings(rig, link, bench.sensors, simulate(rig, link, start, times, commands).states)


def _loop(bench: Bench, run: Run, hub_noise: Array) -> Loop | None:
    """Returns the controller of a run under feedback."""
    if run.reference is None:
        return None
    step = VOLTAGE_STEP * bench.torque_per_volt
    return Loop(True, bench.controller, run.reference, hub_noise, bench.sensors.hub_step, step)


def _kept(run: Run, angle: Array) -> slice:
    """Returns the samples from the end of the lead to where the hub has travelled too far."""
    far = np.abs(angle[run.lead :] - angle[run.lead]) > _TRAVEL
    return slice(run.lead, run.lead + int(np.argmax(far)) if far.any() else len(angle))


def _mapped(recorded: Recorded, rig: Rig, link: Link, state: Array) -> Array:
    """Returns a state for a rig with fewer coordinates: without those between link and hub."""
    nz, fewer = len(state) // 2, coordinates(rig, link)
    kept = np.r_[0 : fewer - 1, nz - 1]
    return np.concatenate([state[:nz][kept], state[nz:][kept]])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
