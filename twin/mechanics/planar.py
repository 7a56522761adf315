"""The chain's equations of motion in compiled code, integrated with stick and slip of the hub located inside a step.

The fits and the search for missing effects integrate this module; MuJoCo, the reference with which results are
reported, integrates the same chain some ten times slower (`twin.mechanics.mujoco_chain`). A test compares the two.

Equations. Coordinates are the absolute angles phi_0 (hub) ... phi_n of n + 1 rigid segments in the plane. With the
constants c_ij of `Chain.inertia` (Lagrange's equations of a planar open chain)

    sum_j c_ij cos(phi_i - phi_j) phi_j'' = - sum_j c_ij sin(phi_i - phi_j) phi_j'^2 + Q_i

`_generalised_forces` fills the mass matrix and the right-hand side except the torques on the hub: moments of the hinges
between neighbouring segments, damping, gravity, drag. `hub_torque` adds the torques of the hub laws, `sliding_level`
the friction. All numbers are fields of `twin.mechanics.plant.Plant`, whose module lists the terms of Q_i.

Stick and slip. Dry friction acts on the hub, or on a motor behind a backlash: read motor for hub there. `mode` is +1 or
-1, the direction in which the hub slides, or 0 while it sticks. While it slides, friction is the sliding level against
the motion. Where the hub's rate crosses zero, the hub sticks if the torque that holds it at rest does not exceed the
static level; it breaks away where that torque does. Both instants are located by the Illinois method (M. Dowell and
P. Jarratt, BIT 11, 1971, 168-174), and integration restarts there.

Appended coordinates follow the segments where an effect needs them: the absolute angle of an oscillator on the hub (a
torsional mode), then that of a motor separated from the hub by backlash. The flanks of the backlash are springs with
dampers whose force can push and not pull.

Reading the code: functions with a leading underscore work in place on preallocated arrays. `phi`, `omega`, `acc` are
angles, rates and accelerations (n + 1 + k); u is the command held now, `age` the time since it came [s], and u_before
the torque that was delivered then, both needed for the motor's lag. Compiled functions stay in this file, because
numba's cache does not notice a change in another one.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from twin.files.compiled import cached_njit
from twin.mechanics import hub_law
from twin.mechanics.plant import CONTACT_PHASE, CONTACT_STEP, Plant

_PLAIN: tuple[Literal["C", "W"], ...] = ("C", "W")
"""Contiguous and writable: one kind of array, for a function is compiled for each kind that it is given."""
_FAST = {"contract", "arcp", "nsz", "reassoc"}
# Without numba's run-time system, compiled functions count no references to arrays, and cannot make any. Counting at
# every call, for the 14 arrays of a `Plant`, took three times as long as the equations.
compiled = cached_njit(error_model="numpy", fastmath=_FAST, nogil=True, _nrt=False)
# Numba passes a `Plant`, some 70 words, by value: functions called at every stage of a step are inlined, by numba, or
# by LLVM where this compiles faster. A function with a copy of its own in each caller would also round differently in
# the process that compiles it, which takes another copy than those that load it.
_inlined = cached_njit(error_model="numpy", fastmath=_FAST, inline="always", nogil=True)
_within = cached_njit(error_model="numpy", fastmath=_FAST, nogil=True, _nrt=False, forceinline=True)

FREE, HUB, MOTOR = 0, 1, 2
"""What is locked during a step."""
STABLE_PHASE = 2.2
"""Phase of the contact in a step at which the Runge-Kutta method is stable, and damps it by a third [rad]."""
SETTLED_SWING = 0.005
"""Amplitude of the motor's oscillation on a flank, over its depth, below which it need not be resolved: for errors and
times with other values see benchmarks/results/contact.md."""
EVENT_TOLERANCE = 1e-7
"""Width of the interval in which the instant of a stick or slip lies [s]."""


@_inlined
def _friction_raise(plant, theta):
    """Increase of both friction levels at hub angle theta [N m]."""
    if plant.friction.amplitude == 0.0:
        return 0.0
    return 0.5 * plant.friction.amplitude * (1 + np.sin(plant.friction.order * theta + plant.friction.phase))


@_within
def static_level(plant, theta, direction):
    """Static friction level [N m] of a hub at rest at angle theta, for a torque in `direction` (+1 or -1)."""
    level = plant.friction.static_positive if direction > 0 else plant.friction.static_negative
    return level + _friction_raise(plant, theta)


@_inlined
def sliding_level(plant, theta, omega, direction):
    """Magnitude of friction [N m] on a hub at angle theta that slides in `direction` at rate `omega` [rad/s]."""
    if direction > 0:
        coulomb, static = plant.friction.coulomb_positive, plant.friction.static_positive
    else:
        coulomb, static = plant.friction.coulomb_negative, plant.friction.static_negative
    if plant.friction.stribeck_velocity > 0.0:
        coulomb += (static - coulomb) * np.exp(-((omega / plant.friction.stribeck_velocity) ** 2))
    return coulomb + _friction_raise(plant, theta)


@_inlined
def law_torque(plant, t, theta, omega, on_motor):
    """Sum of the hub laws' torques [N m] at time t: of those that act on the motor, or of the others."""
    torques, torque = plant.torques, 0.0
    since = t - torques.since
    for k in range(torques.addresses.size):
        if torques.on_motor[k] == on_motor:
            torque += hub_law.call(  # type: ignore[call-arg]
                torques.addresses[k], since, theta, omega, torques.values, torques.first[k]
            )
    return torque


@_inlined
def _rubbing(plant, size):
    """Index of the coordinate on which dry friction acts: the motor's behind a backlash, or the hub's."""
    return size - 1 if plant.friction.on_motor and plant.motor.gap > 0.0 else 0


@_inlined
def contact_torque(plant, play, rate):
    """Contact torque [N m] of the motor on the hub; `play` is motor less hub angle [rad], `rate` its rate [rad/s].

    A flank that is pressed by d has the torque k d + c d', and never pulls: the shaft with linear spring and damper of
    M. Nordin and P.-O. Gutman, Automatica 38, 2002, 1633-1649. The share of the speed with which it rebounds is the
    same at every speed.
    """
    beyond = abs(play) - 0.5 * plant.motor.gap
    if beyond <= 0.0:
        return 0.0
    side = 1.0 if play > 0.0 else -1.0
    return side * max(plant.motor.contact_stiffness * beyond + plant.motor.contact_damping * side * rate, 0.0)


@_inlined
def _contact_step(plant, phi, omega, acc):
    """Largest step [s] of an integration while the motor touches a flank; `acc` are the accelerations.

    Where the motor is pressed on the flank and hardly oscillates there, the step has to be stable and no more.
    """
    last = phi.size - 1
    beyond = abs(phi[last] - phi[0]) - 0.5 * plant.motor.gap
    step = plant.motor.contact_step
    turn = step / CONTACT_PHASE  # reciprocal of its frequency or damping rate
    swing = math.hypot((omega[last] - omega[0]) * turn, (acc[last] - acc[0]) * turn * turn)
    return step * STABLE_PHASE / CONTACT_PHASE if swing < SETTLED_SWING * beyond else step


@_inlined
def hub_torque(plant, t, theta, omega):
    """Torque [N m] of the hub laws on the hub at time t [s]: without motor torque, dry friction and the link.

    Laws that act on the motor are included unless there is backlash.
    """
    torque = law_torque(plant, t, theta, omega, False)
    if plant.motor.gap == 0.0:
        torque += law_torque(plant, t, theta, omega, True)
    return torque


@_within
def _relative_sines(phi, sin, cos):
    """Fills `sin` and `cos` of the angles phi_i - phi_0 (n + 1), which determine the mass matrix.

    Hinge angles below 0.5 rad use a power series with an error below 1e-13, which is faster.
    """
    sin[0], cos[0] = 0.0, 1.0
    for i in range(1, phi.size):
        q = phi[i] - phi[i - 1]
        if abs(q) < 0.5:
            x = q * q
            s = q * (1 - x / 6 * (1 - x / 20 * (1 - x / 42 * (1 - x / 72 * (1 - x / 110)))))
            c = 1 - x / 2 * (1 - x / 12 * (1 - x / 30 * (1 - x / 56 * (1 - x / 90 * (1 - x / 132)))))
        else:
            s, c = np.sin(q), np.cos(q)
        sin[i] = sin[i - 1] * c + cos[i - 1] * s
        cos[i] = cos[i - 1] * c - sin[i - 1] * s


@_inlined
def acceleration_field(plant, t):
    """Acceleration field (x, y) on every mass [m/s^2]: gravity less the acceleration of the base."""
    if plant.link.shake_x == 0.0 and plant.link.shake_y == 0.0:
        return plant.link.gravity_x, plant.link.gravity_y
    shake = np.sin(2 * np.pi * plant.link.shake_frequency * t + plant.link.shake_phase)
    return (
        plant.link.gravity_x - plant.link.shake_x * shake,
        plant.link.gravity_y - plant.link.shake_y * shake,
    )


@_inlined
def _generalised_forces(plant, t, phi, omega, touching, force, mass, sin, cos, bend):
    """Fills the mass matrix `mass` (lower triangle) and the right-hand side `force` without the torques on the hub.

    `bend`, for the rates of the hinges, is overwritten as `sin` and `cos` are.
    """
    m = phi.size
    _relative_sines(phi, sin, cos)
    for i in range(m):
        force[i] = 0.0
    for i in range(m):
        squared = omega[i] * omega[i]
        total = 0.0
        for j in range(i):
            c = plant.link.inertia[i, j]
            mass[i, j] = c * (cos[i] * cos[j] + sin[i] * sin[j])
            s = c * (sin[i] * cos[j] - cos[i] * sin[j])
            total += s * omega[j] * omega[j]
            force[j] += s * squared
        force[i] -= total
        mass[i, i] = plant.link.inertia[i, i]
    # Hinge moments: stiffness, reduced with curvature, and damping.
    links = plant.link.stiffness.size + 1
    for i in range(1, links):
        bend[i - 1] = omega[i] - omega[i - 1]
    for i in range(1, links):
        angle = phi[i] - phi[i - 1]
        moment = plant.link.stiffness[i - 1] * angle
        if plant.link.softening != 0.0:
            kappa2 = (plant.link.flexibility * moment) ** 2 if plant.link.lengths[i - 1] > 0 else 0.0
            moment *= 1 - plant.link.softening * kappa2 / (kappa2 + plant.link.softening_curvature**2)
        for j in range(links - 1):
            moment += plant.link.damping[i - 1, j] * bend[j]
        force[i] -= moment
        force[i - 1] += moment
    if plant.link.torsion_stiffness > 0.0:
        moment = plant.link.torsion_stiffness * (phi[links] - phi[0])
        moment += plant.link.torsion_damping * (omega[links] - omega[0])
        force[links] -= moment
        force[0] += moment
    if touching:
        moment = contact_torque(plant, phi[m - 1] - phi[0], omega[m - 1] - omega[0])
        force[m - 1] -= moment
        force[0] += moment
    if plant.link.drag_linear != 0.0 or plant.link.drag_quadratic != 0.0:
        vx = vy = 0.0
        for i in range(m):
            vx -= plant.link.lengths[i] * sin[i] * omega[i]
            vy += plant.link.lengths[i] * cos[i] * omega[i]
        drag = plant.link.drag_linear + plant.link.drag_quadratic * np.sqrt(vx * vx + vy * vy)
        for i in range(m):
            force[i] -= drag * plant.link.lengths[i] * (cos[i] * vy - sin[i] * vx)
    field_x, field_y = acceleration_field(plant, t)
    if field_x != 0.0 or field_y != 0.0:
        # Components in the hub's frame, as sin and cos are relative to it.
        s, c = np.sin(phi[0]), np.cos(phi[0])
        gx = c * field_x + s * field_y
        gy = c * field_y - s * field_x
        for i in range(m):
            force[i] += plant.link.first_moment[i] * (gy * cos[i] - gx * sin[i])


@_within
def _solve(mass, force, first):
    """Solves mass x = force in place (LDL' factorisation) for rows and columns from `first` on; x replaces `force`."""
    m = force.size
    for i in range(first, m):
        # Row i of L D, then of L; the inverse pivots stay on the diagonal.
        for j in range(first, i):
            s = mass[i, j]
            for k in range(first, j):
                s -= mass[i, k] * mass[j, k]
            mass[i, j] = s
        pivot = mass[i, i]
        x = force[i]
        for j in range(first, i):
            scaled = mass[i, j] * mass[j, j]
            pivot -= scaled * mass[i, j]
            mass[i, j] = scaled
            x -= scaled * force[j]
        mass[i, i] = 1 / pivot
        force[i] = x
    for i in range(m - 1, first - 1, -1):
        s = force[i] * mass[i, i]
        for k in range(i + 1, m):
            s -= mass[k, i] * force[k]
        force[i] = s


@_within
def _accelerations(plant, t, phi, omega, drive, direction, locked, touching, acc, scratch):
    """Fills `acc` (n + 1) under the motor torque `drive`; returns the torque [N m] that holds what is locked, else 0.

    `locked`: `FREE`, or `HUB` or `MOTOR`, whose rate is zero and stays so.
    """
    mass, row = scratch[3:], scratch[2]
    _generalised_forces(plant, t, phi, omega, touching, acc, mass, scratch[0], scratch[1], row)
    m = phi.size
    if plant.motor.gap > 0.0:
        acc[m - 1] += drive + law_torque(plant, t, phi[m - 1], omega[m - 1], True)
        drive = 0.0
    torque = drive + hub_torque(plant, t, phi[0], omega[0])
    if locked == MOTOR:
        # Its inertia is its own: in the mass matrix it is coupled to no other coordinate.
        needed = acc[m - 1]
        acc[0] += torque
        _solve(mass, acc, 0)
        acc[m - 1] = 0.0
        return needed
    if locked == HUB:
        for j in range(1, m):
            row[j] = mass[j, 0]
        needed = acc[0] + torque
        _solve(mass, acc, 1)
        acc[0] = 0.0
        for j in range(1, m):
            needed -= row[j] * acc[j]
        return needed
    acc[0] += torque
    if direction != 0:
        b = _rubbing(plant, m)
        acc[b] -= direction * sliding_level(plant, phi[b], omega[b], direction)
    _solve(mass, acc, 0)
    return 0.0


@_inlined
def _lagged_torque(u, u_before, age, lag):
    """Delivered torque [N m] of a first-order lag, `age` seconds after the command stepped to u from u_before."""
    if lag <= 0.0:
        return u
    return u + (u_before - u) * np.exp(-age / lag)


@_inlined
def _share_of_step(stage):
    """Instant of a stage of the classical Runge-Kutta method, as a share of its step."""
    return 0.5 * ((stage + 1) // 2)


@_inlined
def _to_stage(phi, omega, work, stage, after, phi1):
    """Fills the angles `phi1` and the rates `work[stage]` of a stage, `after` the beginning of its step [s]."""
    before = max(stage - 1, 0)
    for i in range(phi.size):
        phi1[i] = phi[i] + (after * work[before, i] if stage > 0 else 0.0)
        work[stage, i] = omega[i] + (after * work[before + 4, i] if stage > 0 else 0.0)


@_inlined
def _to_end(phi, omega, work, h, phi1, omega1):
    """Fills the state at the end of a step from the rates and accelerations of its stages."""
    for i in range(phi.size):
        phi1[i] = phi[i] + h / 6 * (work[0, i] + 2 * work[1, i] + 2 * work[2, i] + work[3, i])
        omega1[i] = omega[i] + h / 6 * (work[4, i] + 2 * work[5, i] + 2 * work[6, i] + work[7, i])


@_inlined
def _step(plant, t, phi, omega, held, h, phi1, omega1, work, scratch):
    """One classical fourth-order Runge-Kutta step of length h from phi, omega to phi1, omega1.

    What is held during it: the command, the torque delivered when it came and the time since then, the direction of
    sliding, what is locked, and whether the motor is on a flank of the backlash. `work` holds the rates of the four
    stages, then their accelerations, of which the first is given.
    """
    u, u_before, age, direction, locked, touching = held
    for stage in range(4):
        after = _share_of_step(stage) * h
        _to_stage(phi, omega, work, stage, after, phi1)
        if stage > 0:
            drive = _lagged_torque(u, u_before, age + after, plant.motor.lag)
            rate, acc = work[stage], work[stage + 4]
            _accelerations(plant, t + after, phi1, rate, drive, direction, locked, touching, acc, scratch)
    _to_end(phi, omega, work, h, phi1, omega1)
    if locked != FREE:
        b = 0 if locked == HUB else phi.size - 1
        phi1[b] = phi[b]
        omega1[b] = 0.0


@_inlined
def _copy_state(phi, omega, to_phi, to_omega):
    for i in range(phi.size):
        to_phi[i] = phi[i]
        to_omega[i] = omega[i]


@_inlined
def _touches(plant, phi):
    """Whether the motor is on a flank of the backlash."""
    return plant.motor.gap > 0.0 and abs(phi[phi.size - 1] - phi[0]) > 0.5 * plant.motor.gap


@_inlined
def _stuck(plant, size):
    """What is locked while friction holds."""
    return HUB if _rubbing(plant, size) == 0 else MOTOR


@_inlined
def _locked(plant, size, mode, clamped):
    """What is locked during a step."""
    return HUB if clamped else FREE if mode != 0 else _stuck(plant, size)


@_inlined
def _torque_to_hold(plant, t, phi, omega, drive, acc, scratch):
    """Torque [N m] of friction, reversed, that keeps at rest what it acts on, the hub or the motor."""
    stuck = _stuck(plant, phi.size)
    still = np.int64(0)  # for a literal, numba compiles all of it once more
    return _accelerations(plant, t, phi, omega, drive, still, stuck, _touches(plant, phi), acc, scratch)


@_inlined
def _margin_of_hold(plant, theta, needed):
    """Static level less the torque `needed` to keep the hub at rest [N m]: friction holds while it is not negative."""
    return static_level(plant, theta, 1 if needed > 0 else -1) - abs(needed)


NO_EVENT, STOP, SLIP, CONTACT = 0, 1, 2, 3
"""Events: none is possible, the sliding rate crosses zero, friction no longer holds, the motor meets a flank."""


@_inlined
def _next_event(plant, t, held, h, phi, omega, clamped, acc, scratch):
    """The event that is nearest after a step of length h to this state, and its margin; `held` as in `_step`.

    The margin is continuous in time, and negative once the event has happened: depth in the play [rad], sliding rate
    [rad/s] or `_margin_of_hold`.
    """
    u, u_before, age, mode, _, touching = held
    event, margin, b = NO_EVENT, np.inf, _rubbing(plant, phi.size)
    if plant.motor.gap > 0.0 and not touching:
        event, margin = CONTACT, 0.5 * plant.motor.gap - abs(phi[phi.size - 1] - phi[0])
    if clamped:
        return event, margin
    if mode != 0:
        other, nearest = STOP, omega[b] * mode
    else:
        drive = _lagged_torque(u, u_before, age + h, plant.motor.lag)
        needed = _torque_to_hold(plant, t, phi, omega, drive, acc, scratch)
        other, nearest = SLIP, _margin_of_hold(plant, phi[b], needed)
    return (other, nearest) if nearest < margin else (event, margin)


@_inlined
def _step_to_event(plant, t, phi, omega, held, h, clamped, phi1, omega1, acc, work, scratch):
    """A step of length h from phi, omega to phi1, omega1, or to just after the first event in it.

    Returns its length and the event. The instant is found by the Illinois method. The search ends when it comes to the
    root from both sides: near it, each point lies half the tolerance beyond the estimate. Without an event, `acc` holds
    what `_next_event` left.
    """
    event, trial = NO_EVENT, h
    low, high, before, after, moved = 0.0, h, 0.0, 0.0, 0
    searching = True  # a state that is no number, of a simulation that diverges, ends it
    while searching or event != NO_EVENT:
        _step(plant, t, phi, omega, held, trial, phi1, omega1, work, scratch)
        if not searching:
            break
        sooner, margin = _next_event(plant, t + trial, held, trial, phi1, omega1, clamped, acc, scratch)
        if event != NO_EVENT and trial == 0.0:
            before = max(margin, 0.0)
        elif margin < 0.0:
            before *= 0.5 if moved < 0 else 1.0
            moved = -1 if event != NO_EVENT else 0
            high, after, event = trial, margin, sooner
        else:
            low, before = trial, margin
            after *= 0.5 if moved > 0 else 1.0
            moved = 1
        searching = event != NO_EVENT and high - low > EVENT_TOLERANCE
        if not searching:
            trial = high
        elif moved == 0 and trial > 0.0:
            trial = 0.0  # the margin at the beginning
        else:
            mid = low + (high - low) * before / (before - after) + 0.5 * moved * EVENT_TOLERANCE
            trial = min(max(mid, low + 0.5 * EVENT_TOLERANCE), high - 0.5 * EVENT_TOLERANCE)
    return high, event


@_inlined
def _mode_after(plant, t, held, h, phi, omega, event, acc, scratch):
    """The mode after a stop or slip at the end of a step of length h; a stop sets the sliding rate to zero."""
    u, u_before, age, _, _, _ = held
    b = _rubbing(plant, phi.size)
    if event == STOP:
        omega[b] = 0.0
    drive = _lagged_torque(u, u_before, age + h, plant.motor.lag)
    needed = _torque_to_hold(plant, t, phi, omega, drive, acc, scratch)
    if event == STOP and _margin_of_hold(plant, phi[b], needed) >= 0.0:
        return 0
    return 1 if needed > 0 else -1


@_within
def _record(t, h, phi, omega, phi1, omega1, mode, mode1, out, row):
    """Fills the rows whose instants a step of length h has passed; returns the next row.

    Between the ends of the step, angles are cubic Hermite polynomials of the time.
    """
    times, angles, rates, modes = out
    while row < times.size and times[row] <= t + h + 1e-12:
        x = (times[row] - t) / h if h > 0 else 1.0
        if x > 1 - 1e-9:
            _copy_state(phi1, omega1, angles[row], rates[row])
            modes[row] = mode1
        else:
            y = 1 - x
            for i in range(phi.size):
                away = phi1[i] - phi[i]
                begin, end = h * omega[i] - away, away - h * omega1[i]
                angles[row, i] = phi[i] + x * (away + y * (y * begin + x * end))
                rates[row, i] = (away + (y - x) * (y * begin + x * end) + x * y * (end - begin)) / h
            modes[row] = mode
        row += 1
    return row


@compiled
def advance(plant, t, end, phi, omega, u, u_before, age, mode, clamped, h_max, out, row, work, scratch):
    """Integrates phi, omega in place under a held command u; returns the mode at the end, and the next row.

    Args:
      plant: the `Plant`.
      t, end: instants at which the integration begins and ends [s].
      phi, omega: (n + 1 + k) state, overwritten.
      u: command, held [N m].
      u_before: torque that was delivered when the command came [N m].
      age: time since the command came [s].
      mode: 0 while the hub sticks, else the direction +1 or -1 in which it slides; the motor's, if friction acts on it.
      clamped: the hub is locked.
      h_max: largest step [s].
      out: instants (m), angles and rates (m, n + 1 + k) and modes (m), filled from `row` on up to the end.
      row: the first to be filled.
      work, scratch: (11, n + 1 + k) and (n + 4 + k, n + 1 + k), of any content.
    """
    return _advance(
        plant, t, end, phi, omega, u, u_before, age, mode, clamped, h_max, out, row, work, scratch
    )


@_inlined
def _advance(plant, t, end, phi, omega, u, u_before, age, mode, clamped, h_max, out, row, work, scratch):
    phi1, omega1, acc, stages, first = work[8], work[9], work[10], work[:8], work[4]
    left = end - t
    holds = False  # known from the end of the step before: that friction does, and `first`
    while left > 1e-12:
        touching = _touches(plant, phi)
        if not holds:
            drive = _lagged_torque(u, u_before, age, plant.motor.lag)
            for _ in range(2):
                locked = _locked(plant, phi.size, mode, clamped)
                needed = _accelerations(plant, t, phi, omega, drive, mode, locked, touching, first, scratch)
                if clamped or mode != 0:
                    break
                if _margin_of_hold(plant, phi[_rubbing(plant, phi.size)], needed) >= 0.0:
                    break
                mode = 1 if needed > 0 else -1
        locked = _locked(plant, phi.size, mode, clamped)
        longest = min(h_max, _contact_step(plant, phi, omega, first)) if touching else h_max
        h = left / max(1.0, np.ceil(left / longest - 1e-9))
        held = u, u_before, age, mode, locked, touching
        h, event = _step_to_event(plant, t, phi, omega, held, h, clamped, phi1, omega1, acc, stages, scratch)
        if event in (STOP, SLIP):
            mode = _mode_after(plant, t + h, held, h, phi1, omega1, event, acc, scratch)
        row = _record(t, h, phi, omega, phi1, omega1, held[3], mode, out, row)
        _copy_state(phi1, omega1, phi, omega)
        holds = event == NO_EVENT and not clamped and mode == 0
        if holds:
            for i in range(phi.size):
                first[i] = acc[i]
        t += h
        age += h
        left -= h
    while row < out[0].size and out[0][row] <= end:
        row = _record(end, 0.0, phi, omega, phi, omega, mode, mode, out, row)
    return mode, row


STUCK, UNDECIDED = 0, 2
"""Flags of the hub at a measured sample: at rest, or neither rest nor motion is certain; +1 and -1: it moves."""


NO_ROWS = np.empty(0), np.empty((0, 0)), np.empty((0, 0)), np.empty(0)
"""Rows that `advance` fills where none are asked for."""
# Of a free-running simulation.
_NO_FLAGS, _NO_ANCHOR = np.empty(0, dtype=np.int64), np.empty(0)


def simulate(
    plant: Plant,
    command_time: np.ndarray,
    command: np.ndarray,
    out_time: np.ndarray,
    phi0: np.ndarray,
    omega0: np.ndarray,
    mode0: int,
    clamped: bool,
    h_max: float,
    observed: np.ndarray = _NO_FLAGS,
    anchor: np.ndarray = _NO_ANCHOR,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrates from out_time[0] to out_time[-1].

    Free-running where `observed` is empty. Otherwise guided by the measurement: where a flag says that the hub rests or
    moves and the simulation disagrees, its mode is set to the flag; and where a measured rest ends, the whole rig is
    rotated to the measured angle. Between rests the simulation runs freely. So one wrong stick does not offset all that
    follows.

    Args:
      plant: the `Plant`.
      command_time, command: (k) instants [s] and torque [N m] held from each to the next; before the first, 0.
      out_time: (m) instants at which the state is returned [s].
      phi0, omega0: (n + 1 + k) state at out_time[0].
      mode0: mode at out_time[0]: 0 the hub sticks, +1 or -1 it slides.
      clamped: the hub is locked.
      h_max: largest step [s].
      observed: (m) or (0) int64, `STUCK`, +1, -1 or `UNDECIDED` at each instant.
      anchor: (m) or (0) measured hub angle while it rests [rad].

    Returns:
      (m, n + 1 + k) angles [rad], (m, n + 1 + k) rates [rad/s], (m) mode.
    """
    phi, omega = np.array(phi0, dtype=float), np.array(omega0, dtype=float)
    command_time, command, out_time = (
        np.require(values, float, _PLAIN) for values in (command_time, command, out_time)
    )
    size, count = phi.size, out_time.size
    work, scratch = np.empty((11, size)), np.empty((size + 3, size))
    out = np.empty((count, size)), np.empty((count, size)), np.empty(count)
    changes = np.diff(command, prepend=np.nan) != 0
    drive = command_time[changes], command[changes]
    rows = out_time, *out
    _simulate(plant, drive, phi, omega, mode0, clamped, h_max, observed, anchor, rows, work, scratch)
    return out


@_within
def _guide(phi, omega, mode, row, observed, anchor, rates, modes):
    """Imposes the measurement on the state at a row; returns the mode."""
    if observed[row] == STUCK and mode != 0:
        mode = 0
        omega[0] = 0.0
    elif abs(observed[row]) == 1 and mode == 0:
        mode = observed[row]
    rates[row, 0], modes[row] = omega[0], mode
    if observed[row] == STUCK and (row + 1 == observed.size or observed[row + 1] != STUCK):
        turn = anchor[row] - phi[0]
        for i in range(phi.size):
            phi[i] += turn
    return mode


@compiled
def _simulate(
    plant,
    drive,
    phi,
    omega,
    mode0,
    clamped,
    h_max,
    observed,
    anchor,
    out,
    work,
    scratch,
):
    command_time, command = drive
    out_time, angles, rates, modes = out
    t = out_time[0]
    pointer = -1
    u, u_before, since = 0.0, 0.0, t
    while pointer + 1 < command_time.size and command_time[pointer + 1] <= t + 1e-12:
        pointer += 1
    if pointer >= 0:
        u = command[pointer]
        settled = pointer if command_time[pointer] < t - 1e-9 else pointer - 1
        u_before = command[settled] if settled >= 0 else 0.0
    guided = observed.size > 0 and not clamped and _rubbing(plant, phi.size) == 0
    _copy_state(phi, omega, angles[0], rates[0])
    mode, row = mode0, np.int64(1)
    modes[0] = mode
    if guided:
        mode = _guide(phi, omega, mode, 0, observed, anchor, rates, modes)
    while row < out_time.size:
        end = out_time[row] if guided else out_time[out_time.size - 1]
        if pointer + 1 < command_time.size and command_time[pointer + 1] < end:
            end = command_time[pointer + 1]
        age = t - since
        mode, next_row = _advance(
            plant, t, end, phi, omega, u, u_before, age, mode, clamped, h_max, out, row, work, scratch
        )
        if guided and next_row > row:
            mode = _guide(phi, omega, mode, row, observed, anchor, rates, modes)
        t, row = end, next_row
        while pointer + 1 < command_time.size and command_time[pointer + 1] <= t + 1e-12:
            pointer += 1
            u_before = _lagged_torque(u, u_before, t - since, plant.motor.lag)
            u = command[pointer]
            since = t


def holding_torque(
    plant: Plant, time: np.ndarray, angles: np.ndarray, rates: np.ndarray, drive: np.ndarray
) -> np.ndarray:
    """Torque that friction balances while the hub is held at rest, at each instant.

    Args:
      plant: the `Plant`.
      time: (m) [s].
      angles, rates: (m, n + 1 + k) state [rad], [rad/s].
      drive: (m) delivered motor torque [N m].

    Returns:
      (m) [N m], positive where friction keeps the hub from turning to the positive side.
    """
    size, needed = angles.shape[1], np.empty(len(time))
    scratch = np.empty((size + 4, size))
    _holding_torque(plant, time, angles, rates, np.ascontiguousarray(drive), needed, scratch)
    return needed


@compiled
def _holding_torque(plant, time, angles, rates, drive, needed, scratch):
    acc, scratch = scratch[0], scratch[1:]
    for row in range(time.size):
        needed[row] = _torque_to_hold(plant, time[row], angles[row], rates[row], drive[row], acc, scratch)


def simulate_prescribed_hub(
    plant: Plant,
    time: np.ndarray,
    angle: np.ndarray,
    rate: np.ndarray,
    acceleration: np.ndarray,
    middle: np.ndarray,
    phi0: np.ndarray,
    omega0: np.ndarray,
    h_max: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrates the link under a prescribed motion of the hub: no friction, no motor torque, no stick or slip.

    The acceleration is a parabola between instants; hub angle and rate are reset to the given ones at each.

    Args:
      plant: the `Plant`.
      time: (m) instants [s].
      angle, rate, acceleration: (m) of the hub [rad], [rad/s], [rad/s^2].
      middle: (m - 1) acceleration halfway between instants [rad/s^2].
      phi0, omega0: (n + 1 + k) state at the first instant; rotated to angle[0].
      h_max: largest step [s].

    Returns:
      (m, n + 1 + k) angles [rad], (m, n + 1 + k) rates [rad/s], (m) torque on the hub that this motion takes [N m].
    """
    time, angle, rate = (np.ascontiguousarray(v, dtype=float) for v in (time, angle, rate))
    acceleration, middle = (np.ascontiguousarray(v, dtype=float) for v in (acceleration, middle))
    phi, omega = np.array(phi0, dtype=float), np.array(omega0, dtype=float)
    size, count = phi.size, time.size
    out = np.empty((count, size)), np.empty((count, size)), np.empty(count)
    work, scratch = np.empty((9, size)), np.empty((size + 3, size))
    given = time, angle, rate, acceleration, middle
    _simulate_prescribed_hub(plant, *given, phi, omega, h_max, *out, work, scratch)
    return out


@_within
def _prescribed_accelerations(plant, t, phi, omega, alpha, acc, scratch):
    """Fills `acc` (n + 1 + k) under the hub acceleration alpha; returns the hub torque that it takes [N m]."""
    mass, row = scratch[3:], scratch[2]
    _generalised_forces(plant, t, phi, omega, False, acc, mass, scratch[0], scratch[1], row)
    m = phi.size
    hub_force, hub_mass = acc[0], mass[0, 0]
    for j in range(1, m):
        row[j] = mass[j, 0]
        acc[j] -= row[j] * alpha
    _solve(mass, acc, 1)
    torque = hub_mass * alpha - hub_force
    for j in range(1, m):
        torque += row[j] * acc[j]
    acc[0] = alpha
    return torque


@_inlined
def _parabola(start, middle, end, share):
    """The parabola through three equally spaced values, at a share of the way from the first to the last."""
    return start + share * (4 * middle - 3 * start - end + 2 * share * (start - 2 * middle + end))


@compiled
def _simulate_prescribed_hub(
    plant, time, angle, rate, acceleration, middle, phi, omega, h_max, angles, rates, torques, work, scratch
):
    p, m = work[8], phi.size
    turn = angle[0] - phi[0]
    for i in range(m):
        phi[i] += turn
    omega[0] = rate[0]
    for row in range(time.size):
        _copy_state(phi, omega, angles[row], rates[row])
        torques[row] = _prescribed_accelerations(
            plant, time[row], phi, omega, acceleration[row], work[4], scratch
        )
        if row + 1 == time.size:
            break
        span = time[row + 1] - time[row]
        count = int(np.ceil(span / h_max - 1e-9))
        h = span / count
        for step in range(count):
            for stage in range(4):
                share = _share_of_step(stage)
                _to_stage(phi, omega, work, stage, share * h, p)
                if step == 0 and stage == 0:
                    continue  # computed above, with the torque
                t, passed = time[row] + (step + share) * h, (step + share) / count
                alpha = _parabola(acceleration[row], middle[row], acceleration[row + 1], passed)
                _prescribed_accelerations(plant, t, p, work[stage], alpha, work[stage + 4], scratch)
            _to_end(phi, omega, work, h, phi, omega)
        phi[0] = angle[row + 1]
        omega[0] = rate[row + 1]


def hub_torque_along(
    plant: Plant, time: np.ndarray, angle: np.ndarray, rate: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Returns the torque (m) of hub laws and sliding friction along a motion of the hub [N m].

    Args:
      plant: the `Plant`.
      time, angle, rate: (m) of the hub [s], [rad], [rad/s].
      direction: (m) +1 or -1 in which it slides; 0: no friction.
    """
    time, angle, rate, direction = (
        np.ascontiguousarray(v, dtype=float) for v in (time, angle, rate, direction)
    )
    torque = np.empty(len(time))
    _hub_torque_along(plant, time, angle, rate, direction, torque)
    return torque


@compiled
def _hub_torque_along(plant, time, angle, rate, direction, torque):
    for k in range(time.size):
        torque[k] = hub_torque(plant, time[k], angle[k], rate[k])
        if direction[k] != 0:
            torque[k] -= direction[k] * sliding_level(plant, angle[k], rate[k], direction[k])


def mean_friction(plant: Plant, angle: np.ndarray, rate: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Returns the mean torque of sliding friction (m) over steps in each of which the rate is linear in time [N m].

    Args:
      plant: the `Plant`.
      angle, rate: (m) of the hub in the middle of each step [rad], [rad/s].
      change: (m) change of the rate over the step [rad/s].
    """
    angle, rate, change = (np.ascontiguousarray(v, dtype=float) for v in (angle, rate, change))
    torque = np.empty(len(angle))
    _mean_friction(plant, angle, rate, change, torque)
    return torque


@compiled
def _mean_friction(plant, angle, rate, change, torque):
    for k in range(angle.size):
        if abs(change[k]) > 1e-9:
            ends = rate[k] + 0.5 * change[k], rate[k] - 0.5 * change[k]
            mean = (
                _torque_integral(plant, angle[k], ends[0]) - _torque_integral(plant, angle[k], ends[1])
            ) / change[k]
        else:
            mean = np.sign(rate[k]) * sliding_level(plant, angle[k], rate[k], np.sign(rate[k]))
        torque[k] = -mean


@_inlined
def _torque_integral(plant, theta, omega):
    """Integral of the friction torque over the rate from 0 to `omega` [N m rad/s], in closed form."""
    if omega > 0:
        coulomb, static = plant.friction.coulomb_positive, plant.friction.static_positive
    else:
        coulomb, static = plant.friction.coulomb_negative, plant.friction.static_negative
    fallen = 0.0
    if plant.friction.stribeck_velocity > 0.0:
        fallen = math.erf(abs(omega) / plant.friction.stribeck_velocity) * plant.friction.stribeck_velocity
        fallen *= (static - coulomb) * 0.5 * math.sqrt(math.pi)
    return (coulomb + _friction_raise(plant, theta)) * abs(omega) + fallen


def backlash_torque(
    plant: Plant,
    period: float,
    acceleration: np.ndarray,
    angle: np.ndarray,
    drive: np.ndarray,
    mobility: float = 0.0,
    start: float = 0.0,
) -> np.ndarray:
    """Returns the mean torque (c) that backlash passes on to a hub with prescribed motion, in each time cell [N m].

    The motor starts in the middle of the backlash, at rest relative to the hub. Semi-implicit Euler steps, in each of
    which friction on the motor is the impulse that stops it, up to that of its level.

    Args:
      plant: the `Plant`, with backlash.
      period: length of a cell [s].
      acceleration, angle: (c) of the hub in the middle of each cell [rad/s^2], [rad].
      drive: (c) delivered motor torque, its mean over each cell [N m].
      mobility: additional acceleration of the hub per transmitted torque [1/(kg m^2)].
      start: instant of the first cell [s].
    """
    acceleration, angle, drive = (np.ascontiguousarray(v, dtype=float) for v in (acceleration, angle, drive))
    torque, steps = np.zeros(len(drive)), backlash_steps(plant, period)
    _backlash_torque(plant, period, steps, acceleration, angle, drive, mobility, start, torque)
    return torque


def backlash_steps(plant: Plant, period: float) -> int:
    """Number of steps of `backlash_torque` in each cell of length `period` [s]."""
    return math.ceil(period / min(CONTACT_STEP, plant.motor.contact_step))


@compiled
def _backlash_torque(plant, period, count, acceleration, angle, drive, mobility, start, torque):
    # `place` and `rate` are the motor's angle relative to the hub [rad] and its rate [rad/s].
    h, inertia, last = period / count, plant.motor.inertia, drive.size - 1
    place = rate = 0.0
    sticks = False
    for k in range(drive.size):
        hub_rate = (angle[min(k + 1, last)] - angle[max(k - 1, 0)]) / (2 * period)
        own = drive[k] + law_torque(plant, start + k * period, angle[k] + place, hub_rate + rate, True)
        total = 0.0
        for _ in range(count):
            moment = contact_torque(plant, place, rate)
            rate += h * ((own - moment) / inertia - acceleration[k] - mobility * moment)
            if plant.friction.on_motor:
                turning = hub_rate + rate
                direction = 1.0 if turning > 0.0 else -1.0
                if sticks:
                    level = static_level(plant, angle[k] + place, direction)
                else:
                    level = sliding_level(plant, angle[k] + place, turning, direction)
                sticks = inertia * abs(turning) <= h * level
                rate -= turning if sticks else h * direction * level / inertia
            place += h * rate
            total += moment
        torque[k] = total / count
