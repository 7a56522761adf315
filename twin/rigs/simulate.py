"""Simulation of a recording with a model: initial state, motion of the compiled chain, and sensor readings."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import root

from twin.effects import TORSION
from twin.mechanics import planar
from twin.mechanics.chain import Chain
from twin.mechanics.hub_spring import MeasuredHub, Spring
from twin.mechanics.plant import Plant
from twin.mechanics.state import Guide, Motion, Start
from twin.recording import MEASURED, Recording
from twin.rigs.model import Model


def simulate(
    model: Model,
    recording: Recording,
    start: Start,
    guide: Guide | None = None,
    spring: tuple[Spring, MeasuredHub] | None = None,
    stride: int = 1,
) -> Recording:
    """Returns the readings that the model predicts for a recording, simulated with the compiled chain.

    Args:
      model: the model.
      recording: its command, time stamps and channels are used.
      start: state at the first sample.
      guide: measured rests to impose on the simulation; None for a free run.
      spring: that pulls the hub to the measured one, and this; None for a free run.
      stride: of the samples, every so many are predicted; not together with a guide. The torque of the drive is then
        its mean from each of these to the next.
    """
    motion = integrate(model, recording, start, guide, spring, stride)
    return sensor_readings(model, recording, motion, stride=stride)


def integrate(
    model: Model,
    recording: Recording,
    start: Start,
    guide: Guide | None = None,
    spring: tuple[Spring, MeasuredHub] | None = None,
    stride: int = 1,
    instants: np.ndarray | None = None,
) -> Motion:
    """Returns the motion of the chain under a recording's command, at its samples or at other instants (m) [s].

    Arguments as for `simulate`; other instants not together with a guide or a stride.
    """
    plant, times, torques = delivered_torque(model, recording)
    time = recording.time[::stride] if instants is None else instants
    if stride > 1:
        times, torques = _means(times, torques, time)
    if spring is not None:
        pull, hub = spring
        plant = pull.on(plant, hub)
    phi, omega = initial_state(model, recording, start)
    mode = int(np.sign(start.hub_rate)) if abs(start.hub_rate) > 0 else 0
    flags = (guide.observed, guide.anchor) if guide is not None else ()
    phi, omega = plant.extend_state(phi), plant.extend_state(omega)
    if recording.start != "rest":
        # A drive that moves its hub presses on it.
        held = np.searchsorted(times, recording.time[0], side="right") - 1
        phi = plant.on_flank(phi, float(torques[held]))
    motion = planar.simulate(
        plant, times, torques, time, phi, omega, mode, recording.clamped, model.stable_step, *flags
    )
    return Motion.from_coordinates(time, *motion, len(model.chain.lengths))


def _means(times: np.ndarray, torques: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Instants (r) and means from each to the next (r) of torques (k) that are held from `times` (k) on.

    The instants are `time` (m), that before the first command, and the last command.
    """
    knots = np.unique(np.r_[times[0], time, times[-1]])
    impulse = np.r_[0.0, np.cumsum(np.diff(times) * torques[:-1])]
    means = np.diff(np.interp(knots, times, impulse)) / np.diff(knots)
    return knots, np.r_[means, torques[-1]]


def delivered_torque(model: Model, recording: Recording) -> tuple[Plant, np.ndarray, np.ndarray]:
    """Returns the plant with the lag of the drive, and instants [s] and values [N m] of the delivered torque (k)."""
    drive = model.drive(recording)
    # A command long before the first sample gives the torque that was delivered until then.
    times = np.r_[drive.time[0] - 1e3, drive.time]
    plant = model.plant_of(recording).with_motor(lag=float(drive.lag))
    return plant, times, np.r_[drive.before, drive.torque]


def initial_state(model: Model, recording: Recording, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Returns absolute angles [rad] and rates [rad/s] (n + 1) of the segments at the first sample."""
    links = model.chain
    angles, rates = np.zeros(len(links.stiffness)), np.zeros(len(links.stiffness))
    if recording.initial_tip_deflection and recording.start == "rest":
        angles = held_by_tip_force(model, recording.initial_tip_deflection)
    elif any(start.bend) or any(start.bend_rate):
        shapes = bending_shapes(links)
        angles, rates = shapes @ np.array(start.bend), shapes @ np.array(start.bend_rate)
    elif recording.start == "rest":
        angles = gravity_equilibrium(model, start.hub_angle)
    phi = start.hub_angle + np.r_[0.0, np.cumsum(angles)]
    omega = start.hub_rate + np.r_[0.0, np.cumsum(rates)]
    return phi, omega


def bending_shapes(links: Chain) -> np.ndarray:
    """Returns hinge angles (n x 2) of the first two clamped modes per tip deflection [rad/m]."""
    shapes = links.modes("clamped")[1][1:, :2]
    return shapes / (links.levers @ shapes)


def gravity_equilibrium(model: Model, hub_angle: float) -> np.ndarray:
    """Returns hinge angles (n) [rad] in static equilibrium with gravity in the plane, at a hub angle [rad]."""
    plant, size = model.plant, len(model.chain.stiffness)
    bends = np.zeros(size)
    if plant.link.gravity_x == 0 and plant.link.gravity_y == 0:
        return bends
    moments = plant.link.first_moment[: size + 1]
    for _ in range(30):
        phi = hub_angle + np.r_[0.0, np.cumsum(bends)]
        pull = moments * (plant.link.gravity_y * np.cos(phi) - plant.link.gravity_x * np.sin(phi))
        bends = np.cumsum(pull[::-1])[::-1][1:] / plant.link.secant_stiffness(bends)
    return bends


def held_by_tip_force(model: Model, deflection: float) -> np.ndarray:
    """Returns hinge angles (n) [rad] in equilibrium with a transverse tip force that holds the tip at `deflection` [m].

    The moment of the force about each hinge balances its spring, which may be soft; rotations are finite.
    """
    links, link = model.chain, model.plant.link
    scale = links.stiffness.mean()
    guess = deflection / links.static_tip_compliance() * links.levers / links.stiffness

    def unbalance(z: np.ndarray) -> np.ndarray:
        phi = np.r_[0.0, np.cumsum(z[:-1])]
        x = np.cumsum(links.lengths * np.cos(phi))
        tip = np.sum(links.lengths * np.sin(phi))
        moments = link.secant_stiffness(z[:-1]) * z[:-1] / scale - z[-1] * (x[-1] - x[:-1]) / x[-1]
        return np.r_[moments, (tip - deflection) / links.lengths.sum()]

    force = deflection / links.static_tip_compliance() * links.lengths.sum() / scale
    return root(unbalance, np.r_[guess, force], tol=1e-12).x[:-1]


def sensor_readings(
    model: Model, recording: Recording, motion: Motion, began: float | None = None, stride: int = 1
) -> Recording:
    """Returns the readings of a motion, at the samples and in the channels of a recording.

    Args:
      model: the model.
      recording: its channels are used.
      motion: at its samples.
      began: instant from which the drift of a sensor is counted [s]; by default the first of the motion.
      stride: of the samples, every so many are those of the motion.
    """
    with np.errstate(invalid="ignore"):  # a diverged simulation
        true = {c: _true_channel(model, recording, motion, c, stride) for c in recording.measured()}
    if model.plant.link.torsion_stiffness > 0:
        true[TORSION] = motion.extra[:, 0] - motion.angles[:, 0]
    since = motion.time - (motion.time[0] if began is None else began)
    channels = {name: v for name, v in model.report(since, true).items() if name != TORSION}
    given = recording.channels.get("torque_command")
    commanded = {} if given is None else {"torque_command": given[::stride]}
    return Recording(
        recording.name, motion.time, {**commanded, **channels}, recording.clamped, recording.loop
    )


def _true_channel(
    model: Model, recording: Recording, motion: Motion, channel: str, stride: int
) -> np.ndarray:
    """True value (m) of a channel along a motion, SI, before the effects of its sensor."""
    links = model.chain
    hinges = np.diff(motion.angles, axis=1)
    relative = motion.angles - motion.angles[:, :1]
    match channel:
        case "hub_angle":
            return motion.angles[:, 0]
        case "hub_rate":
            return motion.rates[:, 0]
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
            return model.read_torque(recording)[::stride]
    raise ValueError(f"'{channel}' is not simulated. Expected one of: {', '.join(MEASURED)}")


def _tip_acceleration(links: Chain, motion: Motion) -> np.ndarray:
    """Absolute acceleration of the tip perpendicular to the last segment (m) [m/s^2]."""
    swept = links.lengths * motion.rates
    velocity = np.stack([-np.sum(np.sin(motion.angles) * swept, 1), np.sum(np.cos(motion.angles) * swept, 1)])
    if not np.isfinite(velocity).all():  # a diverged simulation
        return np.full(len(motion.time), np.nan)
    acceleration = CubicSpline(motion.time, velocity, axis=1).derivative()(motion.time)
    tip = motion.angles[:, -1]
    return acceleration[1] * np.cos(tip) - acceleration[0] * np.sin(tip)
