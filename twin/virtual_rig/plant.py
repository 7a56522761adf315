"""Equations of motion of hub and link with friction, and an integrator that locates stick and slip events.

State y = [q_1 .. q_n, extras, theta, and the rates of all of them]; extras are a torsional oscillator, a motor
behind a backlash and a loose part of the payload, each present only with its effect. In the axes of the rotating
hub the link is at p(s) = int exp(i psi), accelerated by int (i psi_tt - psi_t^2) exp(i psi) with psi_t absolute;
d'Alembert's principle in the Ritz coordinates gives M(q) z_tt = F. With the link's block of M eliminated, this
reduces to

    J_eff theta_tt = hold - f

where `hold` is the torque needed to hold the hub at rest: motor, cable, ..., and the link's reaction at its root.

Friction: while sliding f = coulomb sgn(omega). Where omega crosses zero the hub sticks if |hold| is below the
static level, else it slides on in the direction of `hold`; stuck, it breaks away when |hold| exceeds that level.
Both events are located to 1e-10 s by bisection of the step length. With bristles (presliding compliance) the stuck
hub is a damped oscillator about the deflection at which their force equals that of sliding, and `hold` is the
bristle torque.

Integrator: the pair 5(4) of J. R. Dormand and P. J. Prince, J. Comput. Appl. Math. 6 (1980), adaptive, with
a step end at every change of the held command, so that no step contains a discontinuity.

All compiled functions are in this module: numba's cache on disk detects changes in the file of a function only, not
in those of the functions that it calls.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.files.compiled import cached_njit
from twin.virtual_rig.beam import Array, Link
from twin.virtual_rig.rig import Rig

STUCK = 0
EVENT_TIME = 1e-10  # s, accuracy of the location of events
RATE_UNIT = 1000.0  # 1/s, scale of rates over that of angles: about the frequency of the high modes
LONGEST_STEP = 1e-3  # s, so that no pair of events is missed within a step
MOST_EVENTS = 20000  # that are recorded
GRAVITY = 9.81  # m/s^2
CONTACT_STIFFNESS = 1000.0  # N m/rad, of the flanks of a backlash
PAYLOAD_STIFFNESS = 2e4  # N/m, of the payload's fixing where a loose part touches it
CONTACT_LOSS = 0.2  # damping ratio of contacts and bristles
KNOCK_LENGTH = 0.01  # s, duration of a half-sine pulse


# Contraction to fused multiply-add is the only permitted change of floating-point operations.
compiled = cached_njit(fastmath={"contract"})


class Drive(NamedTuple):
    """The torque of a held command: target + (start - target) exp(-(t - since)/lag)."""

    target: float  # N m
    start: float  # N m
    since: float  # s


class Loop(NamedTuple):
    """A sampled controller on the measured hub angle; torque [N m] from the error in degrees.

    tau_k = b0 e_k + b1 e_(k-1) + b2 e_(k-2) - a1 tau_(k-1) - a2 tau_(k-2)
    """

    active: bool
    coefficients: Array  # (5,): b0, b1, b2, a1, a2
    reference: Array  # (samples,) [rad]
    noise: Array  # (samples,) of the hub sensor [rad]
    sensor_step: float  # rad, quantisation of the hub sensor; 0 for none
    torque_step: float  # N m, quantisation of the command


class Space(NamedTuple):
    """Work arrays, allocated once per experiment; nz coordinates, N nodes, n link coordinates."""

    mass_matrix: Array  # (nz, nz)
    force: Array  # (nz,)
    sine: Array  # (N,) of the tangent angle
    cosine: Array  # (N,)
    spin: Array  # (N,) absolute rate of the tangent angle
    couple: Array  # (N,)
    product: Array  # (N, n + 1)
    slopes: Array  # (7, 2 nz), dy/dt at the stages of a step
    stage: Array  # (2 nz,)
    new: Array  # (2 nz,), the state at the end of a step
    anchor: Array  # (1,) hub angle at which the bristles of a stuck hub are undeflected [rad]


class Plant(NamedTuple):
    """A rig, its discretised link, and the settings of the integration."""

    rig: Rig
    link: Link
    space: Space
    clamped: bool  # the hub is locked
    tolerance: float


class Log(NamedTuple):
    """Record of stick and slip events."""

    times: Array  # (MOST_EVENTS,) [s]
    modes: Array  # (MOST_EVENTS,)
    number: NDArray[np.int64]  # (1,)


class Motion(NamedTuple):
    """What `run` returns, at the output times."""

    states: Array  # (samples, 2 nz)
    commands: Array  # (samples,) [N m]
    event_times: Array  # (events,) [s]
    event_modes: Array  # (events,) 0: stuck; +1, -1: slides from here on in this direction


@compiled
def saturated(rig, command):
    """Returns the torque of a command by the drive: dead band, limit, dead zone, loss, gain [N m]."""
    if abs(command) <= rig.dead_band:
        return 0.0
    torque = min(max(command, -rig.torque_limit), rig.torque_limit)
    torque -= min(max(torque, -rig.dead_zone), rig.dead_zone)
    if rig.torque_loss != 0.0:
        torque *= 1.0 - rig.torque_loss * (torque / rig.torque_limit) ** 2
    return rig.torque_gain * torque


@compiled
def all_saturated(rig, commands):
    """Returns `saturated` of many commands (samples,) [N m]."""
    result = np.empty(len(commands))
    for k in range(len(commands)):
        result[k] = saturated(rig, commands[k])
    return result


@compiled
def drive_torque(rig, drive, t):
    """Returns the torque that the drive delivers at time t [N m]."""
    if rig.actuator_lag <= 0.0:
        return drive.target
    return drive.target + (drive.start - drive.target) * math.exp(-(t - drive.since) / rig.actuator_lag)


@compiled
def sensed_hub(rig, theta):
    """Returns the reading of the potentiometer without noise [rad]."""
    ripple = rig.hub_ripple * np.sin(rig.hub_ripple_order * theta + rig.hub_ripple_phase)
    return rig.hub_gain * theta + ripple


@compiled
def quantised(value, step):
    """Returns the value rounded to multiples of step; unchanged for step 0."""
    if step <= 0.0:
        return value
    return step * np.rint(value / step)


@compiled
def extras(rig):
    """Returns whether the rig has a torsional oscillator, a motor behind a backlash and a loose payload."""
    backlash = rig.backlash_gap > 0.0 and rig.backlash_motor_share > 0.0
    return rig.torsional_inertia_share > 0.0, backlash, rig.loose_gap > 0.0 and rig.loose_share > 0.0


@compiled
def friction_ripple(rig, theta):
    """Returns A (1 + sin(n theta + phi))/2, which is added to both friction levels [N m]."""
    if rig.friction_ripple == 0.0:
        return 0.0
    angle = rig.friction_ripple_order * theta + rig.friction_ripple_phase
    return rig.friction_ripple * 0.5 * (1.0 + math.sin(angle))


@compiled
def static_level(rig, direction, theta):
    """Returns the static friction level in a direction [N m]."""
    level = rig.static_positive if direction > 0 else rig.static_negative
    return level + friction_ripple(rig, theta)


@compiled
def sliding_friction(rig, t, direction, theta, omega):
    """Returns the friction torque f on a hub that slides in a direction [N m]."""
    level = rig.coulomb_positive if direction > 0 else rig.coulomb_negative
    if rig.stribeck_velocity > 0.0:
        static = rig.static_positive if direction > 0 else rig.static_negative
        level += (static - level) * math.exp(-((omega / rig.stribeck_velocity) ** 2))
    if rig.warming_rise != 0.0:
        level += rig.warming_rise * math.exp(-t / rig.warming_time)
    return direction * (level + friction_ripple(rig, theta)) + rig.viscous_friction * omega


@compiled
def bristles(rig, mode):
    """Returns whether the hub is stuck on compliant bristles."""
    return mode == STUCK and math.isfinite(rig.bristle_stiffness)


@compiled
def bristle_torque(plant, theta):
    """Returns the torque of the bristles [N m]."""
    return plant.rig.bristle_stiffness * (theta - plant.space.anchor[0])


@compiled
def knock(rig, t):
    """Returns the torque of short knocks [N m]: half-sine pulses at irregular times.

    There is one in the middle half of each period, with a pseudo-random time and sign.
    """
    number = math.floor(t / rig.knock_period)
    place = math.sin(12.9898 * (number + 1.0) + rig.knock_phase)
    age = t - rig.knock_period * (number + 0.5 + 0.25 * place)
    if age < 0.0 or age > KNOCK_LENGTH:
        return 0.0
    side = 1.0 if math.sin(78.233 * (number + 1.0) + rig.knock_phase) > 0.0 else -1.0
    return side * rig.knock_torque * math.sin(math.pi * age / KNOCK_LENGTH)


@compiled
def hub_torque(rig, t, theta, omega):
    """Returns the torques on the hub other than drive, friction and link [N m]."""
    torque = rig.torque_bias - rig.cable_stiffness * (theta - rig.cable_rest_angle)
    torque -= rig.cable_hardening * theta**3
    if rig.disturbance_torque != 0.0:
        phase = 2.0 * math.pi * rig.disturbance_frequency * t + rig.disturbance_phase
        torque += rig.disturbance_torque * math.sin(phase)
    if rig.knock_torque != 0.0:
        torque += knock(rig, t)
    if abs(theta) > rig.stop_angle:
        side = 1.0 if theta > 0.0 else -1.0
        push = rig.stop_stiffness * (abs(theta) - rig.stop_angle) + rig.stop_damping * side * omega
        torque -= side * max(push, 0.0)
    return torque


@compiled
def link_balance(plant, t, y):
    """Writes the link's part of the mass matrix and forces.

    With W = `link.together` and B = `link.slope` the mass matrix is B' [W_kl cos(psi_k - psi_l)] B and the
    velocity-dependent inertia forces are -B' sum_l W_kl sin(psi_k - psi_l) psi_t_l^2.
    """
    rig, link, space = plant.rig, plant.link, plant.space
    mass_matrix, force, product = space.mass_matrix, space.force, space.product
    sine, cosine, spin, couple = space.sine, space.cosine, space.spin, space.couple
    nz = len(force)
    nodes, columns = link.slope.shape[0] - 1, link.slope.shape[1]
    n, hub = columns - 1, nz - 1
    theta, omega = y[hub], y[nz + hub]

    # Tangent angle relative to the hub and its absolute rate.
    for k in range(nodes):
        angle, rate = 0.0, omega
        for j in range(n):
            angle += link.slope[k, j] * y[j]
            rate += link.slope[k, j] * y[nz + j]
        sine[k] = math.sin(angle)
        cosine[k] = math.cos(angle)
        spin[k] = rate

    field_x, field_y = body_field(rig, t, theta)
    drag_x, drag_y = tip_drag(rig, link, sine, cosine, spin)

    # The moment on the tangent at each node, from rates, field and drag; and W cos(psi_k - psi_l) B.
    product[:] = 0.0
    for k in range(nodes):
        total = cosine[k] * (link.moment[k] * field_y + link.to_tip[k] * drag_y)
        total -= sine[k] * (link.moment[k] * field_x + link.to_tip[k] * drag_x)
        for m in range(nodes):
            together = link.together[k, m] * (cosine[k] * cosine[m] + sine[k] * sine[m])
            total -= link.together[k, m] * (sine[k] * cosine[m] - cosine[k] * sine[m]) * spin[m] ** 2
            for j in range(columns):
                product[k, j] += together * link.slope[m, j]
        couple[k] = total

    # Project on the coordinates; the hub's is the last one. The payload's inertia turns with the tip.
    mass_matrix[:] = 0.0
    force[:] = 0.0
    for i in range(columns):
        row = i if i < n else hub
        for j in range(i + 1):
            column = j if j < n else hub
            mass_matrix[row, column] = rig.tip_inertia * link.slope[nodes, i] * link.slope[nodes, j]
    for k in range(nodes):
        for i in range(columns):
            row = i if i < n else hub
            weight = link.slope[k, i]
            force[row] += weight * couple[k]
            for j in range(i):
                mass_matrix[row, j] += weight * product[k, j]
            mass_matrix[row, row] += weight * product[k, i]

    # Elastic and damping moments; softening by quadrature of the lost moment.
    left = 1.0 - rig.fading * (1.0 - math.exp(-t / rig.fading_time))
    for i in range(n):
        force[i] -= left * link.stiffness[i] * y[i]
        for j in range(n):
            force[i] -= link.damping[i, j] * y[nz + j]
    if rig.softening != 0.0:
        soften(rig, link, y, force)


@compiled
def body_field(rig, t, theta):
    """Returns the acceleration field on every mass [m/s^2], in the axes of the hub: tilt and shaking base."""
    x = y = 0.0
    if rig.tilt != 0.0:
        down = rig.tilt_direction - theta
        x += GRAVITY * math.sin(rig.tilt) * math.cos(down)
        y += GRAVITY * math.sin(rig.tilt) * math.sin(down)
    if rig.disturbance_acceleration != 0.0:
        phase = 2.0 * math.pi * rig.disturbance_frequency * t + rig.disturbance_phase
        shake = rig.disturbance_acceleration * math.sin(phase)
        x -= shake * math.cos(theta)
        y += shake * math.sin(theta)
    return x, y


@compiled
def tip_drag(rig, link, sine, cosine, spin):
    """Returns the force of the air on the tip [N], in the axes of the hub: -(b + c |v|) v."""
    if rig.air_pad_drag == 0.0 and rig.air_drag == 0.0:
        return 0.0, 0.0
    vx = vy = 0.0
    for k in range(len(spin)):
        vx -= link.to_tip[k] * sine[k] * spin[k]
        vy += link.to_tip[k] * cosine[k] * spin[k]
    drag = rig.air_pad_drag + rig.air_drag * math.sqrt(vx * vx + vy * vy)
    return -drag * vx, -drag * vy


@compiled
def soften(rig, link, y, force):
    """Adds the restoring moment that a softening link loses, EI s kappa^3/(kappa^2 + kappa_0^2), to the forces."""
    nodes, n = link.curvature.shape
    for k in range(nodes):
        kappa = 0.0
        for j in range(n):
            kappa += link.curvature[k, j] * y[j]
        lost = rig.softening * kappa**3 / (kappa * kappa + rig.softening_curvature**2)
        for j in range(n):
            force[j] += rig.bending_stiffness * link.weight[k] * lost * link.curvature[k, j]


@compiled
def contact(play, rate, gap, stiffness, inertia):
    """Returns the contact force (torque) on the flanks of a gap, by position and rate of the body in it."""
    over = abs(play) - 0.5 * gap
    if over <= 0.0:
        return 0.0
    side = 1.0 if play > 0.0 else -1.0
    loss = 2.0 * CONTACT_LOSS * math.sqrt(stiffness * inertia)
    return side * max(stiffness * over + loss * side * rate, 0.0)


@compiled
def extra_balance(plant, torque, y):
    """Adds hub, torsional oscillator, motor behind a backlash and loose payload to mass matrix and forces.

    The first two extras are angles relative to the hub and have a share of its inertia. The drive's torque and the
    cogging act on the motor, friction and all other torques on the hub.
    """
    rig, mass_matrix, force = plant.rig, plant.space.mass_matrix, plant.space.force
    torsional, backlash, loose = extras(rig)
    nz = len(force)
    hub = nz - 1
    row = plant.link.slope.shape[1] - 1
    motor_angle = y[hub]
    mass_matrix[hub, hub] += rig.hub_inertia
    if torsional:
        inertia = rig.torsional_inertia_share * rig.hub_inertia
        frequency = 2.0 * math.pi * rig.torsional_frequency
        mass_matrix[row, row] = inertia
        mass_matrix[hub, row] = inertia
        force[row] = -inertia * frequency * (frequency * y[row] + 2.0 * rig.torsional_damping * y[nz + row])
        row += 1
    motor = row
    if backlash:
        inertia = rig.backlash_motor_share * rig.hub_inertia
        mass_matrix[row, row] = inertia
        mass_matrix[hub, row] = inertia
        motor_angle += y[row]
        force[row] = -contact(y[row], y[nz + row], rig.backlash_gap, CONTACT_STIFFNESS, inertia)
        row += 1
    if loose:
        loose_balance(plant, row, y)
    if rig.cogging_amplitude != 0.0:
        torque += rig.cogging_amplitude * math.sin(rig.cogging_order * motor_angle + rig.cogging_phase)
    if backlash:
        force[motor] += torque
    force[hub] += torque


@compiled
def loose_balance(plant, row, y):
    """Adds a part of the payload that moves across the link within a gap, coordinate `row` [m].

    Its velocity is that of the tip plus its own along the tip's normal; terms by its distance from the tip, millimetres
    against the length of the link, are neglected.
    """
    rig, link, space = plant.rig, plant.link, plant.space
    nz = len(space.force)
    nodes, columns = link.slope.shape[0] - 1, link.slope.shape[1]
    n, hub = columns - 1, nz - 1
    mass = rig.loose_share * rig.tip_mass
    tip = 0.0
    for j in range(n):
        tip += link.slope[nodes, j] * y[j]
    push = -contact(y[row], y[nz + row], rig.loose_gap, PAYLOAD_STIFFNESS, mass)
    for j in range(columns):
        lever = 0.0
        for k in range(nodes):
            across = space.cosine[k] * math.cos(tip) + space.sine[k] * math.sin(tip)
            lever += link.to_tip[k] * across * link.slope[k, j]
        if j < n:
            space.mass_matrix[row, j] = mass * lever
        else:
            space.mass_matrix[hub, row] = mass * lever
    for k in range(nodes):
        aside = space.sine[k] * math.cos(tip) - space.cosine[k] * math.sin(tip)
        push += mass * link.to_tip[k] * space.spin[k] ** 2 * aside
    space.mass_matrix[row, row] = mass
    space.force[row] = push


@compiled
def factorised(matrix, size):
    """Overwrites the lower triangle of a symmetric matrix by its Cholesky factor, except for the last pivot."""
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                # The last pivot is not rooted: it is the effective inertia J_eff of the hub.
                matrix[i, i] = math.sqrt(total) if i < size - 1 else total
            else:
                matrix[i, j] = total / matrix[j, j]


@compiled
def derivative(plant, drive, t, y, mode, out):
    """Writes dy/dt to `out` and returns `hold`, the torque that holds the hub at rest, or that of bristles [N m]."""
    rig, mass_matrix, force = plant.rig, plant.space.mass_matrix, plant.space.force
    nz = len(force)
    hub = nz - 1
    theta, omega = y[hub], y[nz + hub]
    link_balance(plant, t, y)
    force[hub] += hub_torque(rig, t, theta, omega)
    extra_balance(plant, drive_torque(rig, drive, t), y)
    factorised(mass_matrix, nz)

    # Forward substitution; the hub's row then contains the holding torque.
    for i in range(nz):
        total = force[i]
        for k in range(i):
            total -= mass_matrix[i, k] * force[k]
        force[i] = total / mass_matrix[i, i] if i < hub else total
    hold = force[hub]
    acceleration = 0.0
    if mode != STUCK:
        friction = sliding_friction(rig, t, mode, theta, omega)
        acceleration = (hold - friction) / mass_matrix[hub, hub]
    elif bristles(rig, mode) and not plant.clamped:
        inertia = mass_matrix[hub, hub]
        loss = 2.0 * CONTACT_LOSS * math.sqrt(rig.bristle_stiffness * inertia)
        borne = bristle_torque(plant, theta)
        acceleration = (hold - borne - loss * omega) / inertia
        hold = borne

    # Back substitution for the rest, with the hub's acceleration known.
    out[nz + hub] = acceleration
    for i in range(hub - 1, -1, -1):
        total = force[i] - mass_matrix[hub, i] * acceleration
        for k in range(i + 1, hub):
            total -= mass_matrix[k, i] * out[nz + k]
        out[nz + i] = total / mass_matrix[i, i]
    for i in range(nz):
        out[i] = y[nz + i]
    return hold


@compiled
def step(plant, drive, t, y, h, mode):
    """Computes one Dormand-Prince step of length h [s] from slopes[0]; writes space.new and slopes[6].

    Returns the estimated error over the tolerance [1], and the holding torque at the end [N m].
    """
    slopes, stage, new = plant.space.slopes, plant.space.stage, plant.space.new
    size = len(y)
    for i in range(size):
        stage[i] = y[i] + h * slopes[0, i] / 5.0
    derivative(plant, drive, t + h / 5.0, stage, mode, slopes[1])
    for i in range(size):
        stage[i] = y[i] + h * (3.0 / 40.0 * slopes[0, i] + 9.0 / 40.0 * slopes[1, i])
    derivative(plant, drive, t + 0.3 * h, stage, mode, slopes[2])
    for i in range(size):
        stage[i] = y[i] + h * (
            44.0 / 45.0 * slopes[0, i] - 56.0 / 15.0 * slopes[1, i] + 32.0 / 9.0 * slopes[2, i]
        )
    derivative(plant, drive, t + 0.8 * h, stage, mode, slopes[3])
    for i in range(size):
        stage[i] = y[i] + h * (
            19372.0 / 6561.0 * slopes[0, i]
            - 25360.0 / 2187.0 * slopes[1, i]
            + 64448.0 / 6561.0 * slopes[2, i]
            - 212.0 / 729.0 * slopes[3, i]
        )
    derivative(plant, drive, t + 8.0 / 9.0 * h, stage, mode, slopes[4])
    for i in range(size):
        stage[i] = y[i] + h * (
            9017.0 / 3168.0 * slopes[0, i]
            - 355.0 / 33.0 * slopes[1, i]
            + 46732.0 / 5247.0 * slopes[2, i]
            + 49.0 / 176.0 * slopes[3, i]
            - 5103.0 / 18656.0 * slopes[4, i]
        )
    derivative(plant, drive, t + h, stage, mode, slopes[5])
    for i in range(size):
        new[i] = y[i] + h * (
            35.0 / 384.0 * slopes[0, i]
            + 500.0 / 1113.0 * slopes[2, i]
            + 125.0 / 192.0 * slopes[3, i]
            - 2187.0 / 6784.0 * slopes[4, i]
            + 11.0 / 84.0 * slopes[5, i]
        )
    hold = derivative(plant, drive, t + h, new, mode, slopes[6])

    # Difference of the fifth and fourth order solutions.
    error = 0.0
    for i in range(size):
        difference = h * (
            71.0 / 57600.0 * slopes[0, i]
            - 71.0 / 16695.0 * slopes[2, i]
            + 71.0 / 1920.0 * slopes[3, i]
            - 17253.0 / 339200.0 * slopes[4, i]
            + 22.0 / 525.0 * slopes[5, i]
            - 1.0 / 40.0 * slopes[6, i]
        )
        unit = 1.0 if 2 * i < size else RATE_UNIT
        scale = plant.tolerance * (unit + max(abs(y[i]), abs(new[i])))
        error += (difference / scale) ** 2
    return math.sqrt(error / size), hold


@compiled
def excess(rig, hold, theta):
    """Returns the holding torque less the static level in its direction [N m]."""
    direction = 1 if hold > 0.0 else -1
    return abs(hold) - static_level(rig, direction, theta)


@compiled
def violation(rig, mode, y, hold):
    """Returns the event function of a mode, positive after its end: reversed rate, or torque above the static level."""
    if mode == STUCK:
        return excess(rig, hold, y[len(y) // 2 - 1])
    return -mode * y[-1]


@compiled
def lowest_time(h, w0, w1, a0, a1):
    """Returns the time in a step at which a rate, a cubic of end values w and slopes a, is lowest below zero, or 0."""
    if w0 <= 0.0 or w1 <= 0.0 or a0 >= 0.0 or a1 <= 0.0:
        return 0.0
    best, at = 0.0, 0.0
    for k in range(1, 10):
        x = k / 10.0
        value = (
            (1.0 + 2.0 * x) * (1.0 - x) ** 2 * w0
            + x * (1.0 - x) ** 2 * h * a0
            + x * x * (3.0 - 2.0 * x) * w1
            + x * x * (x - 1.0) * h * a1
        )
        if value < best:
            best, at = value, x * h
    return at


@compiled
def dipped(plant, y, h, mode):
    """Returns the time in the last step of the largest reversed rate, if the hub reverses twice in it [s], or 0."""
    slopes, new = plant.space.slopes, plant.space.new
    if mode == STUCK:
        return 0.0
    return lowest_time(h, mode * y[-1], mode * new[-1], mode * slopes[0, -1], mode * slopes[6, -1])


@compiled
def event_step(plant, drive, t, y, h, mode):
    """Computes a step that ends just after the first event within h, and returns its length [s]."""
    low, high = 0.0, h
    while high - low > EVENT_TIME:
        middle = 0.5 * (low + high)
        _, hold = step(plant, drive, t, y, middle, mode)
        if violation(plant.rig, mode, plant.space.new, hold) > 0.0:
            high = middle
        else:
            low = middle
    step(plant, drive, t, y, high, mode)
    return high


@compiled
def mode_after(plant, drive, t, y, mode):
    """Returns the mode after an event at which the hub is at rest: a sliding hub may stick, a stuck one slides.

    A hub that sticks on bristles begins with the deflection at which their torque is that of sliding.
    """
    if math.isfinite(plant.rig.bristle_stiffness):
        if mode == STUCK:
            return 1 if bristle_torque(plant, y[len(y) // 2 - 1]) > 0.0 else -1
        theta = y[len(y) // 2 - 1]
        bent = sliding_friction(plant.rig, t, mode, theta, 0.0)
        plant.space.anchor[0] = theta - bent / plant.rig.bristle_stiffness
        return STUCK
    hold = derivative(plant, drive, t, y, STUCK, plant.space.slopes[0])
    if mode != STUCK and excess(plant.rig, hold, y[len(y) // 2 - 1]) <= 0.0:
        return STUCK
    return 1 if hold > 0.0 else -1


@compiled
def noted(log, t, mode):
    """Records an event, up to the capacity of the log."""
    if log.number[0] < len(log.times):
        log.times[log.number[0]] = t
        log.modes[log.number[0]] = mode
        log.number[0] += 1


@compiled
def advance(plant, drive, y, t, end, mode, trial, log):
    """Integrates y in place from t to end under one held command.

    Returns the mode at the end and the next trial step length [s].
    """
    rig, slopes, new = plant.rig, plant.space.slopes, plant.space.new
    hub = len(y) // 2 - 1
    hold = derivative(plant, drive, t, y, mode, slopes[0])
    blind = 0.0
    while end - t > 1e-12:
        # A stuck hub breaks away at once where a new command exceeds its static level.
        if mode == STUCK and not plant.clamped and t >= blind and excess(rig, hold, y[hub]) > 0.0:
            mode = 1 if hold > 0.0 else -1
            hold = derivative(plant, drive, t, y, mode, slopes[0])
            noted(log, t, mode)
        h = min(trial, end - t)
        error, new_hold = step(plant, drive, t, y, h, mode)
        if error > 1.0:
            trial = h * max(0.2, 0.9 * error ** (-0.2))
            continue
        if not plant.clamped and t + h > blind:
            dip = dipped(plant, y, h, mode)
            if dip > 1e-9:
                h = trial = dip
                error, new_hold = step(plant, drive, t, y, h, mode)
            if violation(rig, mode, new, new_hold) > 0.0:
                h = event_step(plant, drive, t, y, h, mode)
                if h < 2.0 * EVENT_TIME:
                    # Stuck and released at one instant: no events are located for 1 us.
                    blind = t + 1e-6
                t += h
                y[:] = new
                if not bristles(rig, mode):
                    y[-1] = 0.0
                mode = mode_after(plant, drive, t, y, mode)
                hold = derivative(plant, drive, t, y, mode, slopes[0])
                noted(log, t, mode)
                continue
        t += h
        y[:] = new
        slopes[0, :] = slopes[6, :]
        hold = new_hold
        # The step length is not adapted after a step that was shortened to end at `end`.
        growth = min(5.0, 0.9 * max(error, 1e-10) ** (-0.2))
        if h >= trial or growth < 1.0:
            trial = min(h * growth, LONGEST_STEP)
    return mode, trial


@compiled
def controlled(loop, sample, measured, errors, torques):
    """Returns the command of a controller [N m]; `errors` [deg] and `torques` hold past values, newest first."""
    errors[2], errors[1] = errors[1], errors[0]
    errors[0] = math.degrees(loop.reference[sample] - measured)
    c = loop.coefficients
    torque = c[0] * errors[0] + c[1] * errors[1] + c[2] * errors[2] - c[3] * torques[0] - c[4] * torques[1]
    torques[1], torques[0] = torques[0], torque
    return quantised(torque, loop.torque_step)


@compiled
def run(plant, start, command_times, commands, output_times, loop):
    """Integrates an experiment; see `simulate`."""
    rig = plant.rig
    y = start.copy()
    hub = len(y) // 2 - 1
    log = Log(np.zeros(MOST_EVENTS), np.zeros(MOST_EVENTS), np.zeros(1, dtype=np.int64))
    samples = len(output_times)
    states = np.zeros((samples, len(y)))
    issued = commands.copy()
    errors, torques = np.zeros(3), np.zeros(2)

    t, trial = 0.0, 1e-4
    mode = STUCK
    plant.space.anchor[0] = y[hub]
    if y[-1] != 0.0 and not plant.clamped:
        mode = 1 if y[-1] > 0.0 else -1
    drive = Drive(0.0, 0.0, 0.0)
    read = given = 0
    while read < samples:
        # Readings are taken before the command of the same instant, which depends on them.
        reading = given >= samples or output_times[read] <= command_times[given] + 1e-12
        due = max(output_times[read], 0.0) if reading else command_times[given]
        mode, trial = advance(plant, drive, y, t, due, mode, trial, log)
        t = max(t, due)
        if reading:
            states[read] = y
            if loop.active:
                measured = quantised(sensed_hub(rig, y[hub]) + loop.noise[read], loop.sensor_step)
                issued[read] = controlled(loop, read, measured, errors, torques)
            read += 1
        else:
            drive = Drive(saturated(rig, issued[given]), drive_torque(rig, drive, t), t)
            given += 1
    return states, issued, log.times[: log.number[0]], log.modes[: log.number[0]]


def working_space(link: Link, nz: int) -> Space:
    """Returns the work arrays for a rig of nz coordinates."""
    nodes, columns = link.slope.shape[0] - 1, link.slope.shape[1]
    return Space(
        mass_matrix=np.zeros((nz, nz)),
        force=np.zeros(nz),
        sine=np.zeros(nodes),
        cosine=np.zeros(nodes),
        spin=np.zeros(nodes),
        couple=np.zeros(nodes),
        product=np.zeros((nodes, columns)),
        slopes=np.zeros((7, 2 * nz)),
        stage=np.zeros(2 * nz),
        new=np.zeros(2 * nz),
        anchor=np.zeros(1),
    )


def coordinates(rig: Rig, link: Link) -> int:
    """Returns the number of coordinates nz: link, extras, hub."""
    return len(link.stiffness) + int(sum(extras(rig))) + 1


def at_rest(rig: Rig, link: Link, hub_angle: float, shape: Array) -> Array:
    """Returns the state (2 nz,) of a resting rig with a hub angle [rad] and link coordinates `shape` (n,)."""
    nz = coordinates(rig, link)
    state = np.zeros(2 * nz)
    state[: len(shape)] = shape
    state[nz - 1] = hub_angle
    return state


def open_loop() -> Loop:
    """Returns the inactive controller of an open-loop experiment."""
    return Loop(False, np.zeros(5), np.zeros(0), np.zeros(0), 0.0, 0.0)


def simulate(
    rig: Rig,
    link: Link,
    start: Array,
    times: Array,
    commands: Array,
    *,
    clamped: bool = False,
    loop: Loop | None = None,
    tolerance: float = 1e-7,
) -> Motion:
    """Returns the motion of the rig at the sample times.

    Args:
        rig: The true rig.
        link: Its discretised link.
        start: Initial state (2 nz,).
        times: Sample times (samples,) [s], increasing from 0; commands are held from one to the next.
        commands: Torque commands (samples,) [N m]; ignored where `loop` computes them.
        clamped: Whether the hub is locked.
        loop: A controller, or None.
        tolerance: Error of each step, relative to 1 rad and 1000 rad/s plus the state.

    Returns:
        The motion at `sensor_delay` before each sample time; commands act `actuator_delay` after theirs.
    """
    plant = Plant(rig, link, working_space(link, len(start) // 2), clamped, tolerance)
    return Motion(
        *run(
            plant,
            np.ascontiguousarray(start, dtype=float),
            times + rig.actuator_delay,
            np.ascontiguousarray(commands, dtype=float),
            times - rig.sensor_delay,
            loop or open_loop(),
        )
    )


def delivered_torque(rig: Rig, times: Array, commands: Array) -> Array:
    """Returns the delivered torque at the times of the sensors' readings (samples,) [N m].

    It includes gain, limit, dead time, lag and bias; a reading at the instant of a new command includes that command.
    """
    return rig.torque_bias + _commanded_torque(rig, times, commands)


def _commanded_torque(rig: Rig, times: Array, commands: Array) -> Array:
    command_times = times + rig.actuator_delay
    targets = all_saturated(rig, commands)
    at = times - rig.sensor_delay
    latest = np.searchsorted(command_times, at + 1e-12, side="right") - 1
    if rig.actuator_lag <= 0.0:
        return np.where(latest >= 0, targets[latest], 0.0)
    # Torque at the start of every hold, then along it.
    starts = np.zeros(len(targets))
    decay = np.exp(-np.diff(command_times) / rig.actuator_lag)
    for k, factor in enumerate(decay):
        starts[k + 1] = targets[k] + (starts[k] - targets[k]) * factor
    age = np.maximum(at - command_times[latest], 0.0)
    torque = targets[latest] + (starts[latest] - targets[latest]) * np.exp(-age / rig.actuator_lag)
    return np.where(latest >= 0, torque, 0.0)


def torsion_angle(rig: Rig, link: Link, states: Array) -> Array:
    """Returns the angle of the torsional oscillator relative to the hub (samples,) [rad]; 0 without one."""
    if not extras(rig)[0]:
        return np.zeros(len(states))
    return np.asarray(states[:, len(link.stiffness)])


def hub_angle(rig: Rig, link: Link, states: Array) -> Array:
    """Returns the hub angle (samples,) [rad] of states (samples x 2 nz)."""
    return np.asarray(states[:, coordinates(rig, link) - 1])
