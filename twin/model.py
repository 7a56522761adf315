"""The twin as one value: a rig, the effects added to it, and what its sensors would report."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import root

from twin import chain, planar
from twin.chain import Chain, ChainShape
from twin.effects import REGISTRY, TORSION, Drive
from twin.parameters import Rig
from twin.patch import Patch
from twin.recording import MEASURED, Recording, Sensor

Effects = Mapping[str, Mapping[str, float]]
"""Effect name -> parameter name -> value, SI."""


@dataclass(frozen=True)
class Motion:
    """State of the chain over time; n hinges, m instants.

    Attributes:
      time: (m) [s].
      angles: (m, n + 1) absolute angles of the segments [rad].
      rates: (m, n + 1) [rad/s].
      modes: (m) 0 where the hub sticks, +1 or -1 where it slides.
      extra, extra_rates: (m, k) of coordinates that effects add: absolute angles of a torsional mode, of a motor
        with play.
    """

    time: np.ndarray
    angles: np.ndarray
    rates: np.ndarray
    modes: np.ndarray
    extra: np.ndarray
    extra_rates: np.ndarray

    @staticmethod
    def of(time: np.ndarray, angles: np.ndarray, rates: np.ndarray, modes: np.ndarray, links: int) -> Motion:
        """Splits the coordinates of a plant (m, n + 1 + k) into those of the link (n + 1) and the others."""
        return Motion(time, angles[:, :links], rates[:, :links], modes, angles[:, links:], rates[:, links:])

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles and rates of all coordinates (m, n + 1 + k), as the plant has them."""
        return np.hstack([self.angles, self.extra]), np.hstack([self.rates, self.extra_rates])


@dataclass(frozen=True)
class Start:
    """State at the first sample.

    Attributes:
      hub_angle, hub_rate: of the hub [rad], [rad/s].
      bend, bend_rate: amplitude of the first two clamped modes (2) and its rate, as tip deflection [m], [m/s].
    """

    hub_angle: float = 0.0
    hub_rate: float = 0.0
    bend: tuple[float, float] = (0.0, 0.0)
    bend_rate: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Guide:
    """What the measured hub angle says of sticking and sliding: see `planar.simulate`.

    Attributes:
      observed: (m) int64 flags.
      anchor: (m) measured angle while the hub rests [rad].
    """

    observed: np.ndarray
    anchor: np.ndarray


@dataclass(frozen=True)
class Model:
    """A rig with effects.

    Attributes:
      declared: the rig without effects.
      sensors: channel -> how it is measured.
      shape: proportions of the chain.
      effects: effects that act, with their parameters.
      step: largest integration step [s].
      late: how much later than stamped a card puts its commands out [s].
      patch: a correction without a cause, looked up; None for none.
    """

    declared: Rig
    sensors: Mapping[str, Sensor]
    shape: ChainShape
    effects: Effects = field(default_factory=dict)
    step: float = 1e-3
    late: float = 0.0
    patch: Patch | None = None

    def replace(self, **changes) -> Model:
        """Returns a model with some attributes changed."""
        return replace(self, **changes)

    @functools.cached_property
    def rig(self) -> Rig:
        """The rig with what the effects change in it."""
        rig = self.declared
        for name, p in self.effects.items():
            rig = REGISTRY[name].rig(rig, p)
        return rig

    @functools.cached_property
    def chain(self) -> Chain:
        """The chain of `rig` with what the effects change in it."""
        links = chain.build(self.rig, shape=self.shape)
        for name, p in self.effects.items():
            links = REGISTRY[name].links(links, self.rig, p)
        return links

    @functools.cached_property
    def gauge_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row from hinge angles, the clamp rigid, to the curvature at its gauge [1/m per rad]."""
        gauges = {name: s for name, s in self.sensors.items() if s.half_thickness}
        links = self.chain.rigid or self.chain
        return {name: self.gauge_row(links, s.position) for name, s in gauges.items()}

    def gauge_row(self, links: Chain, x: float) -> np.ndarray:
        """Row (n) from hinge angles of links on a rigid clamp to the curvature at x [1/m per rad]."""
        return chain.curvature_row(links, self.rig, x)

    @functools.cached_property
    def curvature_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge angles to the curvature at its gauge [1/m per rad]."""
        return {name: chain.through_root(self.chain, row) for name, row in self.gauge_rows.items()}

    @functools.cached_property
    def curvature_rate_rows(self) -> dict[str, np.ndarray]:
        """Channel -> row (n) from hinge rates to the curvature at its gauge [s/m per rad], where there is one."""
        rows = {name: chain.lagging_row(self.chain, row) for name, row in self.gauge_rows.items()}
        return {name: row for name, row in rows.items() if row is not None}

    @functools.cached_property
    def plant(self) -> planar.Plant:
        """What the equations of motion read."""
        plant = planar.declared_plant(self.rig, self.chain)
        for name, p in self.effects.items():
            plant = REGISTRY[name].plant(plant, p)
        if self.patch is not None and self.patch.place:
            plant = plant._replace(
                patch_on=self.patch.place, patch_x=self.patch.x.copy(), patch_y=self.patch.y.copy()
            )
        return plant

    @property
    def link_step(self) -> float:
        """Integration step [s] of the link by itself: `step`, or less where the chain asks for less."""
        return min(self.step, self.chain.largest_step())

    @property
    def stable_step(self) -> float:
        """Integration step [s]: `link_step`, or less where what stands behind the chain asks for less."""
        return min(self.link_step, planar.largest_step(self.plant))

    def with_plant(self, **changes: Any) -> Model:
        """A model whose plant has some fields changed, whatever the rig and the effects say."""
        changed = self.replace()
        changed.__dict__["plant"] = self.plant._replace(**changes)
        return changed

    def with_break_away(self, share: float) -> Model:
        """A model whose static levels are so many times as large: at least the Coulomb ones.

        A hub that came free below what it slides against would stop at once, and come free again, without end.
        """
        p = self.plant
        return self.with_plant(
            static_positive=max(share * p.static_positive, p.coulomb_positive),
            static_negative=max(share * p.static_negative, p.coulomb_negative),
        )

    def drive(self, recording: Recording) -> Drive:
        """Delivered torque of a recording's command: saturated, then through the effects of the drive."""
        limit = self.declared["torque_limit"]
        put_out = recording.commanded_at + self.late
        command = self._through_effects(Drive(put_out, np.clip(recording["torque_command"], -limit, limit)))
        if self.patch is not None:
            command = command.replace(torque=self.patch.on_command(command.torque))
        return command

    @property
    def torque_gain(self) -> float:
        """Torque that is delivered for one that is commanded [1], whatever else is added to it."""
        steps = self._through_effects(Drive(np.arange(2.0), np.arange(2.0)))
        return float(np.diff(steps.torque)[0])

    def _through_effects(self, drive: Drive) -> Drive:
        for name, p in self.effects.items():
            drive = REGISTRY[name].drive(drive, p)
        return drive

    def read_torque(self, recording: Recording) -> np.ndarray:
        """Delivered torque at the samples of a recording: a card reads it as it puts its commands out."""
        return self.drive(recording).at(recording.commanded_at + self.late)

    def report(self, time: np.ndarray, true: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What the sensors report of true channel values (name -> (m,), SI), `time` from the start of a recording."""
        for name, p in self.effects.items():
            true = REGISTRY[name].sensing(time, true, p)
        return true if self.patch is None else self.patch.on_reading(time, true)

    @property
    def hub_late(self) -> float:
        """By how much the hub's reading lags behind its angle [s]: what it does in the end is not read any more."""
        return sum(REGISTRY[name].hub_late(p) for name, p in self.effects.items())

    def hub_angle_of(self, reading: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Hub angle (m,) that the sensor reports as `reading`."""
        for name, p in reversed(list(self.effects.items())):
            reading = REGISTRY[name].hub_angle_of(time, reading, p)
        return reading


def simulate(model: Model, recording: Recording, start: Start, guide: Guide | None = None) -> Recording:
    """Returns what the sensors of the recording would have reported, simulated with the compiled chain."""
    motion = integrate(model, recording, start, guide)
    return reported(model, recording, motion)


def integrate(model: Model, recording: Recording, start: Start, guide: Guide | None = None) -> Motion:
    """Moves the chain under the recording's command."""
    plant, times, torques = delivered(model, recording)
    phi, omega = initial_state(model, recording, start)
    mode = int(np.sign(start.hub_rate)) if abs(start.hub_rate) > 0 else 0
    flags = (guide.observed, guide.anchor) if guide is not None else ()
    phi, omega = planar.extended(plant, phi), planar.extended(plant, omega)
    motion = planar.simulate(
        plant, times, torques, recording.time, phi, omega, mode, recording.clamped, model.stable_step, *flags
    )
    return Motion.of(recording.time, *motion, len(model.chain.lengths))


def delivered(model: Model, recording: Recording) -> tuple[planar.Plant, np.ndarray, np.ndarray]:
    """The plant, its motor as slow as the drive makes it, and what the drive delivers: instants [s], torques [N m]."""
    drive = model.drive(recording)
    # A command before the first sample stands for what the drive delivered until then.
    times = np.r_[drive.time[0] - 1e3, drive.time]
    plant = model.plant._replace(lag=float(drive.lag))
    if model.patch is not None and model.patch.variable == "time":
        plant = plant._replace(patch_x=plant.patch_x + recording.time[0])
    return plant, times, np.r_[drive.before, drive.torque]


def initial_state(model: Model, recording: Recording, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Absolute angles and rates (n + 1) at the first sample."""
    links = model.chain
    angles, rates = np.zeros(len(links.stiffness)), np.zeros(len(links.stiffness))
    if recording.initial_tip_deflection and recording.start == "rest":
        angles = held_by_tip_force(links, recording.initial_tip_deflection)
    elif any(start.bend) or any(start.bend_rate):
        shapes = bending_shapes(links)
        angles, rates = shapes @ np.array(start.bend), shapes @ np.array(start.bend_rate)
    elif recording.start == "rest":
        angles = hanging(model, start.hub_angle)
    phi = start.hub_angle + np.r_[0.0, np.cumsum(angles)]
    omega = start.hub_rate + np.r_[0.0, np.cumsum(rates)]
    return phi, omega


def bending_shapes(links: Chain) -> np.ndarray:
    """Hinge angles (n x 2) of the first two clamped modes, per tip deflection [rad/m]."""
    shapes = links.modes("clamped")[1][1:, :2]
    levers = links.lengths.sum() - links.hinges
    return shapes / (levers @ shapes)


def hanging(model: Model, hub_angle: float) -> np.ndarray:
    """Hinge angles (n) of a link at rest under what gravity acts in the plane."""
    plant, size = model.plant, len(model.chain.stiffness)
    bends = np.zeros(size)
    if plant.gravity_x == 0 and plant.gravity_y == 0:
        return bends
    moments = plant.first_moment[: size + 1]
    for _ in range(30):
        phi = hub_angle + np.r_[0.0, np.cumsum(bends)]
        pull = moments * (plant.gravity_y * np.cos(phi) - plant.gravity_x * np.sin(phi))
        bends = np.cumsum(pull[::-1])[::-1][1:] / plant.stiffness
    return bends


def held_by_tip_force(links: Chain, deflection: float) -> np.ndarray:
    """Hinge angles (n) at which a tip force across the hub's direction holds the tip at `deflection` [m].

    The moment of the force about each hinge balances its spring; finite rotations.
    """
    scale = links.stiffness.mean()
    levers = links.lengths.sum() - links.hinges
    guess = deflection / links.static_tip_compliance() * levers / links.stiffness

    def unbalance(z: np.ndarray) -> np.ndarray:
        phi = np.r_[0.0, np.cumsum(z[:-1])]
        x = np.cumsum(links.lengths * np.cos(phi))
        tip = np.sum(links.lengths * np.sin(phi))
        moments = links.stiffness * z[:-1] / scale - z[-1] * (x[-1] - x[:-1]) / x[-1]
        return np.r_[moments, (tip - deflection) / links.lengths.sum()]

    force = deflection / links.static_tip_compliance() * links.lengths.sum() / scale
    return root(unbalance, np.r_[guess, force], tol=1e-12).x[:-1]


def reported(model: Model, recording: Recording, motion: Motion) -> Recording:
    """What the sensors report of a motion, at the samples and in the channels of the recording."""
    with np.errstate(invalid="ignore"):  # a simulation that ran away
        true = {channel: _true(model, recording, motion, channel) for channel in recording.measured()}
    if model.plant.torsion_stiffness > 0:
        true[TORSION] = motion.extra[:, 0] - motion.angles[:, 0]
    since = motion.time - motion.time[0]
    channels = {name: v for name, v in model.report(since, true).items() if name != TORSION}
    commanded = {"torque_command": recording["torque_command"]} if "torque_command" in recording else {}
    return Recording(
        recording.name, motion.time, {**commanded, **channels}, recording.clamped, recording.loop
    )


def _true(model: Model, recording: Recording, motion: Motion, channel: str) -> np.ndarray:
    links = model.chain
    hinges = np.diff(motion.angles, axis=1)
    relative = motion.angles - motion.angles[:, :1]
    match channel:
        case "hub_angle":
            return motion.angles[:, 0]
        case "strain_base" | "strain_mid":
            sensor = model.sensors[channel]
            curvature = hinges @ model.curvature_rows[channel]
            if channel in model.curvature_rate_rows:
                curvature += np.diff(motion.rates, axis=1) @ model.curvature_rate_rows[channel]
            return sensor.half_thickness * curvature
        case "tip_deflection":
            return np.sin(relative) @ links.lengths
        case "tip_acceleration":
            return _tip_acceleration(links, motion)
        case "motor_torque":
            return model.read_torque(recording)
    raise ValueError(f"'{channel}' is not simulated. Expected one of: {', '.join(MEASURED)}")


def _tip_acceleration(links: Chain, motion: Motion) -> np.ndarray:
    """Absolute acceleration of the tip across the link's end (m) [m/s^2]."""
    swept = links.lengths * motion.rates
    velocity = np.stack([-np.sum(np.sin(motion.angles) * swept, 1), np.sum(np.cos(motion.angles) * swept, 1)])
    if not np.isfinite(velocity).all():  # a simulation that ran away
        return np.full(len(motion.time), np.nan)
    acceleration = CubicSpline(motion.time, velocity, axis=1).derivative()(motion.time)
    tip = motion.angles[:, -1]
    return acceleration[1] * np.cos(tip) - acceleration[0] * np.sin(tip)
