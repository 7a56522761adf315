"""The chain's equations of motion, compiled: what the search for missing effects integrates.

MuJoCo is the reference that every result is reported with; this module integrates the same chain some ten
times faster and locates every stick and slip inside the step. A test holds the two together.

Coordinates are the absolute angles phi_0 (hub) ... phi_n of n + 1 rigid segments, so that with the constants
c_ij of `Chain.inertia` (Lagrange, planar open chain)

    sum_j c_ij cos(phi_i - phi_j) phi_j'' = - sum_j c_ij sin(phi_i - phi_j) phi_j'^2 + Q_i

and the hinge moments act between neighbours. Friction acts on the hub only. Sliding, it is the Coulomb level
against the motion; where the hub's rate crosses zero it sticks if the torque that holds it is below the static
level, and slides again where that torque exceeds it. Both instants are located by bisection.

Extra coordinates stand behind the segments where an effect asks for them: the absolute angle of an oscillator on
the hub (a torsional mode), then that of a motor with play between it and the hub. The flanks of the play are
springs with a damper that push and never pull; their numbers are assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from twin.mechanics.chain import Chain

_FAST = {"contract", "arcp", "nsz", "reassoc"}
compiled = njit(cache=True, error_model="numpy", fastmath=_FAST, nogil=True)
# A `Plant` is some 70 words, passed by value: what is called at every stage is inlined.
_inlined = njit(cache=True, error_model="numpy", fastmath=_FAST, inline="always", nogil=True)

TIME_TOLERANCE = 1e-7
"""Width of the interval in which a stick or slip is located [s]."""

FIRM = 1e9
"""Static level of a hub that no torque moves out of a rest [N m]."""

CONTACT_STIFFNESS = 1000.0
"""Of the flanks of a backlash [N m/rad]: the largest torque of a motor like this turns them by 0.01 degrees."""
CONTACT_LOSS = 0.2
"""Damping ratio of the motor's inertia on a flank: it comes back with half of its speed, as steel on steel."""
CONTACT_STEP = 1e-4
"""Largest step with which the motor is followed through a contact of some 2 ms [s]."""


class Plant(NamedTuple):
    """Everything the equations of motion read, SI units. Neutral values switch a mechanism off.

    Arrays are for n hinges and n + 1 segments, and behind these the extra coordinates.
    """

    lengths: np.ndarray  # (n + 1) m
    inertia: np.ndarray  # (n + 1, n + 1) kg m^2, c_ij
    stiffness: np.ndarray  # (n) N m/rad
    damping: np.ndarray  # (n, n) N m s/rad, on the hinge rates
    first_moment: np.ndarray  # (n + 1) kg m, sum of mass times lever along segment i
    flexibility: float  # 1/(N m^2), curvature of the link per bending moment
    static_positive: float = 0.0
    static_negative: float = 0.0
    coulomb_positive: float = 0.0
    coulomb_negative: float = 0.0
    stribeck_velocity: float = 0.0
    friction_amplitude: float = 0.0
    friction_order: float = 1.0
    friction_phase: float = 0.0
    viscous: float = 0.0
    cable_stiffness: float = 0.0
    cable_rest_angle: float = 0.0
    cogging_amplitude: float = 0.0
    cogging_order: float = 1.0
    cogging_phase: float = 0.0
    bias: float = 0.0
    disturbance_amplitude: float = 0.0
    disturbance_frequency: float = 1.0
    disturbance_phase: float = 0.0
    lag: float = 0.0
    tip_drag_linear: float = 0.0
    tip_drag_quadratic: float = 0.0
    softening: float = 0.0
    softening_curvature: float = 1.0
    gravity_x: float = 0.0
    gravity_y: float = 0.0
    shake_x: float = 0.0  # m/s^2, amplitude of an acceleration of the base
    shake_y: float = 0.0
    shake_frequency: float = 1.0
    shake_phase: float = 0.0
    torsion_stiffness: float = 0.0  # N m/rad, of an oscillator on the hub
    torsion_damping: float = 0.0  # N m s/rad
    gap: float = 0.0  # rad, whole play between motor and hub
    motor_inertia: float = 0.0  # kg m^2, of a motor with play; `inertia` has it already
    hub_inertia: float = 0.0  # kg m^2, as declared; `inertia` has it already
    patch_on: int = 0  # variable of a looked-up torque on the hub: 1 its angle, 2 its rate, 3 time, 0 none
    patch_x: np.ndarray = np.zeros(2)  # (k) values of the variable
    patch_y: np.ndarray = np.zeros(2)  # (k) N m
    contact_loss: float = CONTACT_LOSS  # damping ratio of a motor with play on its flanks

    @property
    def is_shaken(self) -> bool:
        """Whether its base is accelerated."""
        return self.shake_x != 0 or self.shake_y != 0

    @property
    def curvature_per_angle(self) -> np.ndarray:
        """Curvature that a hinge angle stands for (n) [1/m per rad]: none at a clamp that gives, on the hub's axis."""
        return np.where(self.lengths[: len(self.stiffness)] > 0, self.flexibility * self.stiffness, 0.0)


def with_torsion(plant: Plant, inertia: float, stiffness: float, damping: float) -> Plant:
    """A plant with an oscillator on the hub, whose inertia [kg m^2] is taken from the hub's."""
    # It stands before the motor, which keeps the last place.
    place = len(plant.lengths) - (1 if plant.gap > 0 else 0)
    return _with_extra(plant, inertia, place)._replace(torsion_stiffness=stiffness, torsion_damping=damping)


def with_backlash(plant: Plant, gap: float, motor_inertia: float, loss: float = CONTACT_LOSS) -> Plant:
    """A plant whose motor has a play against the hub.

    Args:
      plant: the plant.
      gap: the play in all [rad].
      motor_inertia: the motor's part of the hub's inertia [kg m^2].
      loss: damping ratio of the motor on the flanks [1].
    """
    behind = _with_extra(plant, motor_inertia, len(plant.lengths))
    return behind._replace(gap=gap, motor_inertia=motor_inertia, contact_loss=loss)


def without_motor(plant: Plant) -> Plant:
    """What is behind the play: the same plant where it has none, else the hub without the motor."""
    if plant.gap <= 0:
        return plant
    return plant._replace(
        lengths=plant.lengths[:-1],
        inertia=np.ascontiguousarray(plant.inertia[:-1, :-1]),
        first_moment=plant.first_moment[:-1],
        gap=0.0,
        cogging_amplitude=0.0,
    )


def closed(plant: Plant) -> Plant:
    """A plant whose motor stays on the flank that pushes: the same where it has no play."""
    if plant.gap <= 0:
        return plant
    behind = without_motor(plant)
    inertia = behind.inertia.copy()
    inertia[0, 0] += plant.motor_inertia
    return behind._replace(inertia=inertia, motor_inertia=0.0, cogging_amplitude=plant.cogging_amplitude)


def _with_extra(plant: Plant, inertia: float, place: int) -> Plant:
    """A plant with one more coordinate on the hub's axis, its inertia [kg m^2] taken from the hub's."""
    matrix = np.insert(np.insert(plant.inertia, place, 0.0, axis=0), place, 0.0, axis=1)
    matrix[0, 0] -= inertia
    matrix[place, place] = inertia
    return plant._replace(
        lengths=np.insert(plant.lengths, place, 0.0),
        inertia=np.ascontiguousarray(matrix),
        first_moment=np.insert(plant.first_moment, place, 0.0),
    )


def largest_step(plant: Plant) -> float:
    """Longest step [s] that the extra coordinates allow."""
    return CONTACT_STEP if plant.gap > 0 else np.inf


def extended(plant: Plant, state: np.ndarray) -> np.ndarray:
    """A state (n + 1) of the link as one of the plant: extra coordinates move with the hub."""
    return np.r_[state, np.full(len(plant.lengths) - len(state), state[0])]


def declared_plant(rig: Mapping[str, float], chain: Chain) -> Plant:
    """The plant of a rig with its declared friction and no other mechanism."""
    coulomb = rig.get("coulomb_friction", 0.0)
    static = max(rig.get("static_friction", 0.0), coulomb)
    plant = Plant(
        chain.lengths,
        np.ascontiguousarray(chain.inertia),
        chain.stiffness,
        np.ascontiguousarray(chain.damping),
        np.ascontiguousarray(chain.first_moment),
        1 / float(rig["bending_stiffness"]),
    )
    return plant._replace(
        static_positive=float(static),
        static_negative=float(static),
        coulomb_positive=float(coulomb),
        coulomb_negative=float(coulomb),
        hub_inertia=float(rig["hub_inertia"]),
    )


@_inlined
def _friction_raise(plant, theta):
    if plant.friction_amplitude == 0.0:
        return 0.0
    return 0.5 * plant.friction_amplitude * (1 + np.sin(plant.friction_order * theta + plant.friction_phase))


@compiled
def static_level(plant, theta, direction):
    """Torque [N m] that a resting hub withstands in `direction` (+1 or -1)."""
    level = plant.static_positive if direction > 0 else plant.static_negative
    return level + _friction_raise(plant, theta)


@_inlined
def sliding_level(plant, theta, omega, direction):
    """Friction torque [N m] on a hub that slides in `direction` at rate `omega` [rad/s]."""
    if direction > 0:
        coulomb, static = plant.coulomb_positive, plant.static_positive
    else:
        coulomb, static = plant.coulomb_negative, plant.static_negative
    if plant.stribeck_velocity > 0.0:
        coulomb += (static - coulomb) * np.exp(-((omega / plant.stribeck_velocity) ** 2))
    return coulomb + _friction_raise(plant, theta)


@_inlined
def cogging(plant, angle):
    """Torque [N m] of the motor's magnets at its angle."""
    return plant.cogging_amplitude * np.sin(plant.cogging_order * angle + plant.cogging_phase)


@_inlined
def contact_damping(plant):
    """Of a flank of the play [N m s/rad]."""
    return 2 * plant.contact_loss * np.sqrt(CONTACT_STIFFNESS * plant.motor_inertia)


@_inlined
def contact_torque(plant, play, rate):
    """Torque [N m] from the motor to the hub at their relative angle [rad] and rate [rad/s]."""
    beyond = abs(play) - 0.5 * plant.gap
    if beyond <= 0.0:
        return 0.0
    side = 1.0 if play > 0.0 else -1.0
    return side * max(CONTACT_STIFFNESS * beyond + contact_damping(plant) * side * rate, 0.0)


@compiled
def _looked_up(plant, value):
    """Torque [N m] of the patch: linear between its points, constant beyond them."""
    x, y = plant.patch_x, plant.patch_y
    if value <= x[0]:
        return y[0]
    if value >= x[-1]:
        return y[-1]
    k = np.searchsorted(x, value)
    return y[k - 1] + (y[k] - y[k - 1]) * (value - x[k - 1]) / (x[k] - x[k - 1])


@_inlined
def hub_torque(plant, t, theta, omega):
    """Torque [N m] on the hub at time t [s] from everything but the drive, dry friction and the link.

    The magnets' is among them unless there is a play between motor and hub.
    """
    torque = plant.bias - plant.viscous * omega - plant.cable_stiffness * (theta - plant.cable_rest_angle)
    if plant.cogging_amplitude != 0.0 and plant.gap == 0.0:
        torque += cogging(plant, theta)
    if plant.disturbance_amplitude != 0.0:
        angle = 2 * np.pi * plant.disturbance_frequency * t + plant.disturbance_phase
        torque += plant.disturbance_amplitude * np.sin(angle)
    if plant.patch_on != 0:
        torque += _looked_up(plant, theta if plant.patch_on == 1 else omega if plant.patch_on == 2 else t)
    return torque


@compiled
def _directions(phi, sin, cos):
    """Fills sin and cos of the angles (n + 1) relative to the hub, which is all that the inertia depends on.

    Hinge angles are small: their sine and cosine come from a series, good to 1e-13 below 0.5 rad.
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
def field(plant, t):
    """Acceleration field on every mass [m/s^2]: gravity, and what a base that is shaken takes away."""
    if plant.shake_x == 0.0 and plant.shake_y == 0.0:
        return plant.gravity_x, plant.gravity_y
    shake = np.sin(2 * np.pi * plant.shake_frequency * t + plant.shake_phase)
    return plant.gravity_x - plant.shake_x * shake, plant.gravity_y - plant.shake_y * shake


@_inlined
def _generalised_forces(plant, t, phi, omega, force, mass, sin, cos):
    """Fills `force` (n + 1) with all but hub torques and `mass` (n + 1, n + 1) with the mass matrix."""
    m = phi.size
    _directions(phi, sin, cos)
    for i in range(m):
        force[i] = 0.0
    for i in range(m):
        squared = omega[i] * omega[i]
        total = 0.0
        for j in range(i):
            c = plant.inertia[i, j]
            mass[i, j] = c * (cos[i] * cos[j] + sin[i] * sin[j])
            s = c * (sin[i] * cos[j] - cos[i] * sin[j])
            total += s * omega[j] * omega[j]
            force[j] += s * squared
        force[i] -= total
        mass[i, i] = plant.inertia[i, i]
    # Hinge moments: stiffness (softening with curvature) and modal damping.
    links = plant.stiffness.size + 1
    for i in range(1, links):
        angle = phi[i] - phi[i - 1]
        moment = plant.stiffness[i - 1] * angle
        if plant.softening != 0.0:
            kappa2 = (plant.flexibility * moment) ** 2 if plant.lengths[i - 1] > 0 else 0.0
            moment *= 1 - plant.softening * kappa2 / (kappa2 + plant.softening_curvature**2)
        for j in range(1, links):
            moment += plant.damping[i - 1, j - 1] * (omega[j] - omega[j - 1])
        force[i] -= moment
        force[i - 1] += moment
    if plant.torsion_stiffness > 0.0:
        moment = plant.torsion_stiffness * (phi[links] - phi[0])
        moment += plant.torsion_damping * (omega[links] - omega[0])
        force[links] -= moment
        force[0] += moment
    if plant.gap > 0.0:
        moment = contact_torque(plant, phi[m - 1] - phi[0], omega[m - 1] - omega[0])
        force[m - 1] -= moment
        force[0] += moment
    if plant.tip_drag_linear != 0.0 or plant.tip_drag_quadratic != 0.0:
        vx = vy = 0.0
        for i in range(m):
            vx -= plant.lengths[i] * sin[i] * omega[i]
            vy += plant.lengths[i] * cos[i] * omega[i]
        drag = plant.tip_drag_linear + plant.tip_drag_quadratic * np.sqrt(vx * vx + vy * vy)
        for i in range(m):
            force[i] -= drag * plant.lengths[i] * (cos[i] * vy - sin[i] * vx)
    field_x, field_y = field(plant, t)
    if field_x != 0.0 or field_y != 0.0:
        # In the hub's frame.
        s, c = np.sin(phi[0]), np.cos(phi[0])
        gx = c * field_x + s * field_y
        gy = c * field_y - s * field_x
        for i in range(m):
            force[i] += plant.first_moment[i] * (gy * cos[i] - gx * sin[i])


@compiled
def _solve(mass, force, first):
    """Solves mass x = force in place for rows and columns from `first` on (Cholesky, LDL'); x in `force`."""
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


@compiled
def _accelerations(plant, t, phi, omega, drive, direction, locked, acc, scratch):
    """Fills `acc` (n + 1); returns the torque [N m] that friction must bear to hold a locked hub."""
    mass, row = scratch[3:], scratch[2]
    _generalised_forces(plant, t, phi, omega, acc, mass, scratch[0], scratch[1])
    m = phi.size
    if plant.gap > 0.0:
        acc[m - 1] += drive + cogging(plant, phi[m - 1])
        drive = 0.0
    torque = drive + hub_torque(plant, t, phi[0], omega[0])
    if locked:
        for j in range(1, m):
            row[j] = mass[j, 0]
        needed = acc[0] + torque
        _solve(mass, acc, 1)
        acc[0] = 0.0
        for j in range(1, m):
            needed -= row[j] * acc[j]
        return needed
    if direction != 0:
        torque -= direction * sliding_level(plant, phi[0], omega[0], direction)
    acc[0] += torque
    _solve(mass, acc, 0)
    return 0.0


@compiled
def _drive(u, u_before, age, lag):
    """Delivered torque [N m] `age` seconds after the command stepped to u from a delivered u_before."""
    if lag <= 0.0:
        return u
    return u + (u_before - u) * np.exp(-age / lag)


@compiled
def _step(plant, t, phi, omega, u, u_before, age, direction, locked, h, phi1, omega1, work, scratch):
    """One classical Runge-Kutta step of length h; the result goes to phi1, omega1."""
    m = phi.size
    k1v, k2v, k3v, k4v, k1a, k2a, k3a, k4a = work
    for i in range(m):
        k1v[i] = omega[i]
    _accelerations(plant, t, phi, omega, _drive(u, u_before, age, plant.lag), direction, locked, k1a, scratch)
    half = _drive(u, u_before, age + h / 2, plant.lag)
    for i in range(m):
        phi1[i] = phi[i] + 0.5 * h * k1v[i]
        k2v[i] = omega[i] + 0.5 * h * k1a[i]
    _accelerations(plant, t + h / 2, phi1, k2v, half, direction, locked, k2a, scratch)
    for i in range(m):
        phi1[i] = phi[i] + 0.5 * h * k2v[i]
        k3v[i] = omega[i] + 0.5 * h * k2a[i]
    _accelerations(plant, t + h / 2, phi1, k3v, half, direction, locked, k3a, scratch)
    for i in range(m):
        phi1[i] = phi[i] + h * k3v[i]
        k4v[i] = omega[i] + h * k3a[i]
    end = _drive(u, u_before, age + h, plant.lag)
    _accelerations(plant, t + h, phi1, k4v, end, direction, locked, k4a, scratch)
    for i in range(m):
        phi1[i] = phi[i] + h / 6 * (k1v[i] + 2 * k2v[i] + 2 * k3v[i] + k4v[i])
        omega1[i] = omega[i] + h / 6 * (k1a[i] + 2 * k2a[i] + 2 * k3a[i] + k4a[i])
    if locked:
        phi1[0] = phi[0]
        omega1[0] = 0.0


@compiled
def _needed(plant, t, phi, omega, drive, acc, scratch):
    """Torque [N m] that friction must bear to keep the hub at rest."""
    return _accelerations(plant, t, phi, omega, drive, 0, True, acc, scratch)


@compiled
def _holds(plant, theta, needed):
    return abs(needed) <= static_level(plant, theta, 1 if needed > 0 else -1)


@compiled
def advance(plant, t, span, phi, omega, u, u_before, age, mode, clamped, h_max, work, scratch):
    """Integrates phi, omega (n + 1) in place over `span` [s] under a held command u.

    `mode` is 0 while the hub sticks, else the direction +1 or -1 in which it slides. Returns the mode at the end.
    """
    m = phi.size
    phi1, omega1, acc = np.empty(m), np.empty(m), np.empty(m)
    left = span
    while left > 1e-12:
        if not clamped:
            drive = _drive(u, u_before, age, plant.lag)
            if mode == 0:
                needed = _needed(plant, t, phi, omega, drive, acc, scratch)
                if not _holds(plant, phi[0], needed):
                    mode = 1 if needed > 0 else -1
        locked = clamped or mode == 0
        h = left / max(1.0, np.ceil(left / h_max - 1e-9))
        _step(plant, t, phi, omega, u, u_before, age, mode, locked, h, phi1, omega1, work, scratch)
        if not clamped:
            crossed = mode != 0 and omega1[0] * mode < 0.0
            slipped = False
            if mode == 0:
                drive = _drive(u, u_before, age + h, plant.lag)
                needed = _needed(plant, t + h, phi1, omega1, drive, acc, scratch)
                slipped = not _holds(plant, phi[0], needed)
            if crossed or slipped:
                # Bisect for the instant of the event, then restart behind it.
                low, high = 0.0, h
                while high - low > TIME_TOLERANCE:
                    mid = 0.5 * (low + high)
                    _step(
                        plant, t, phi, omega, u, u_before, age, mode, locked, mid, phi1, omega1, work, scratch
                    )
                    if crossed:
                        beyond = omega1[0] * mode < 0.0
                    else:
                        drive = _drive(u, u_before, age + mid, plant.lag)
                        needed = _needed(plant, t + mid, phi1, omega1, drive, acc, scratch)
                        beyond = not _holds(plant, phi[0], needed)
                    if beyond:
                        high = mid
                    else:
                        low = mid
                h = high
                _step(plant, t, phi, omega, u, u_before, age, mode, locked, h, phi1, omega1, work, scratch)
                drive = _drive(u, u_before, age + h, plant.lag)
                if crossed:
                    omega1[0] = 0.0
                needed = _needed(plant, t + h, phi1, omega1, drive, acc, scratch)
                onwards = 1 if needed > 0 else -1
                mode = 0 if crossed and _holds(plant, phi1[0], needed) else onwards
        for i in range(m):
            phi[i] = phi1[i]
            omega[i] = omega1[i]
        t += h
        age += h
        left -= h
    return mode


STUCK, UNSURE = 0, 2
"""What the measurement says of the hub at a sample: it rests, or no clear word; +1 and -1: it moves."""


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

    Free-running where `observed` is empty. Otherwise guided: where the measurement is sure that the hub rests or
    moves and the model disagrees, the model follows; and where a measured rest ends, the whole rig is turned to
    the measured angle. Between rests the run is free, so a stick too many or too few does not decide the rest.

    Args:
      plant: the `Plant`.
      command_time, command: (k) instants [s] and torque [N m] held from each to the next; before the first, 0.
      out_time: (m) instants at which the state is wanted [s].
      phi0, omega0: (n + 1) state at out_time[0].
      mode0: 0 hub sticks, +1 or -1 it slides.
      clamped: the hub is locked.
      h_max: largest step [s].
      observed: (m) or (0) int64, `STUCK`, +1, -1 or `UNSURE` at each instant.
      anchor: (m) or (0) measured hub angle while it rests [rad].

    Returns:
      (m, n + 1) angles [rad], (m, n + 1) rates [rad/s], (m) mode.
    """
    phi, omega = np.array(phi0, dtype=float), np.array(omega0, dtype=float)
    command_time, command, out_time = (
        np.ascontiguousarray(values, dtype=float) for values in (command_time, command, out_time)
    )
    return _simulate(
        plant, command_time, command, out_time, phi, omega, mode0, clamped, h_max, observed, anchor
    )


@compiled
def _simulate(plant, command_time, command, out_time, phi, omega, mode0, clamped, h_max, observed, anchor):
    size = phi.size
    work = np.empty((8, size))
    scratch = np.empty((size + 3, size))
    angles = np.empty((out_time.size, size))
    rates = np.empty((out_time.size, size))
    modes = np.empty(out_time.size)
    t = out_time[0]
    pointer = -1
    u, u_before, since = 0.0, 0.0, t
    while pointer + 1 < command_time.size and command_time[pointer + 1] <= t + 1e-12:
        pointer += 1
    if pointer >= 0:
        u = command[pointer]
        settled = pointer if command_time[pointer] < t - 1e-9 else pointer - 1
        u_before = command[settled] if settled >= 0 else 0.0
    mode = mode0
    for row in range(out_time.size):
        while t < out_time[row] - 1e-12:
            end = out_time[row]
            if pointer + 1 < command_time.size and command_time[pointer + 1] < end:
                end = command_time[pointer + 1]
            mode = advance(
                plant, t, end - t, phi, omega, u, u_before, t - since, mode, clamped, h_max, work, scratch
            )
            t = end
            while pointer + 1 < command_time.size and command_time[pointer + 1] <= t + 1e-12:
                pointer += 1
                u_before = _drive(u, u_before, t - since, plant.lag)
                u = command[pointer]
                since = t
        if observed.size > 0 and not clamped:
            if observed[row] == STUCK and mode != 0:
                mode = 0
                omega[0] = 0.0
            elif abs(observed[row]) == 1 and mode == 0:
                mode = observed[row]
        angles[row] = phi
        rates[row] = omega
        modes[row] = mode
        if (
            observed.size > 0
            and not clamped
            and observed[row] == STUCK
            and (row + 1 == out_time.size or observed[row + 1] != STUCK)
        ):
            turn = anchor[row] - phi[0]
            for i in range(size):
                phi[i] += turn
    return angles, rates, modes


def holding_torque(
    plant: Plant, time: np.ndarray, angles: np.ndarray, rates: np.ndarray, drive: np.ndarray
) -> np.ndarray:
    """Torque [N m] that friction bears while it keeps the hub at rest, at each instant.

    Args:
      plant: the `Plant`.
      time: (m) [s].
      angles, rates: (m, n + 1) state [rad], [rad/s].
      drive: (m) delivered torque [N m].

    Returns:
      (m) positive where friction keeps the hub from turning to the positive side.
    """
    return _holding_torque(plant, time, angles, rates, np.ascontiguousarray(drive))


@compiled
def _holding_torque(plant, time, angles, rates, drive):
    size = angles.shape[1]
    acc, scratch = np.empty(size), np.empty((size + 3, size))
    needed = np.empty(time.size)
    for row in range(time.size):
        needed[row] = _needed(plant, time[row], angles[row], rates[row], drive[row], acc, scratch)
    return needed


def driven(
    plant: Plant,
    time: np.ndarray,
    angle: np.ndarray,
    rate: np.ndarray,
    acceleration: np.ndarray,
    phi0: np.ndarray,
    omega0: np.ndarray,
    h_max: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moves the link under a prescribed motion of the hub: no friction, no drive, no stick or slip.

    Args:
      plant: the `Plant`.
      time: (m) instants [s].
      angle, rate, acceleration: (m) of the hub [rad], [rad/s], [rad/s^2].
      phi0, omega0: (n + 1) state at the first instant.
      h_max: largest step [s].

    Returns:
      (m, n + 1) angles, (m, n + 1) rates, and (m) the torque [N m] on the hub that this motion takes.
    """
    time, angle, rate = (np.ascontiguousarray(v, dtype=float) for v in (time, angle, rate))
    acceleration = np.ascontiguousarray(acceleration, dtype=float)
    phi, omega = np.array(phi0, dtype=float), np.array(omega0, dtype=float)
    return _driven(plant, time, angle, rate, acceleration, phi, omega, h_max)


@compiled
def _driven_accelerations(plant, t, phi, omega, alpha, acc, scratch):
    """Fills acc (n + 1) under a hub acceleration alpha; returns the hub torque that it takes."""
    mass, row = scratch[3:], scratch[2]
    _generalised_forces(plant, t, phi, omega, acc, mass, scratch[0], scratch[1])
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


@compiled
def _driven(plant, time, angle, rate, acceleration, phi, omega, h_max):
    m = phi.size
    k1v, k2v, k3v, k4v = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    k1a, k2a, k3a, k4a = np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    p, scratch = np.empty(m), np.empty((m + 3, m))
    angles, rates, torques = np.empty((time.size, m)), np.empty((time.size, m)), np.empty(time.size)
    turn = angle[0] - phi[0]
    for i in range(m):
        phi[i] += turn
    omega[0] = rate[0]
    for row in range(time.size):
        angles[row] = phi
        rates[row] = omega
        torques[row] = _driven_accelerations(plant, time[row], phi, omega, acceleration[row], k1a, scratch)
        if row + 1 == time.size:
            break
        span = time[row + 1] - time[row]
        count = int(np.ceil(span / h_max - 1e-9))
        h = span / count
        slope = (acceleration[row + 1] - acceleration[row]) / span
        for step in range(count):
            t = time[row] + step * h
            start = acceleration[row] + slope * step * h
            middle, end = start + slope * h / 2, start + slope * h
            for i in range(m):
                k1v[i] = omega[i]
            if step > 0:  # the first is known: it gave the torque
                _driven_accelerations(plant, t, phi, omega, start, k1a, scratch)
            for i in range(m):
                p[i] = phi[i] + 0.5 * h * k1v[i]
                k2v[i] = omega[i] + 0.5 * h * k1a[i]
            _driven_accelerations(plant, t + h / 2, p, k2v, middle, k2a, scratch)
            for i in range(m):
                p[i] = phi[i] + 0.5 * h * k2v[i]
                k3v[i] = omega[i] + 0.5 * h * k2a[i]
            _driven_accelerations(plant, t + h / 2, p, k3v, middle, k3a, scratch)
            for i in range(m):
                p[i] = phi[i] + h * k3v[i]
                k4v[i] = omega[i] + h * k3a[i]
            _driven_accelerations(plant, t + h, p, k4v, end, k4a, scratch)
            for i in range(m):
                phi[i] += h / 6 * (k1v[i] + 2 * k2v[i] + 2 * k3v[i] + k4v[i])
                omega[i] += h / 6 * (k1a[i] + 2 * k2a[i] + 2 * k3a[i] + k4a[i])
        phi[0] = angle[row + 1]
        omega[0] = rate[row + 1]
    return angles, rates, torques


def hub_laws(
    plant: Plant, time: np.ndarray, angle: np.ndarray, rate: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """Torque [N m] of the hub laws and of sliding friction along a motion of the hub (m,); direction 0: no friction."""
    time, angle, rate, direction = (
        np.ascontiguousarray(v, dtype=float) for v in (time, angle, rate, direction)
    )
    return _hub_laws(plant, time, angle, rate, direction)


@compiled
def _hub_laws(plant, time, angle, rate, direction):
    torque = np.empty(time.size)
    for k in range(time.size):
        torque[k] = hub_torque(plant, time[k], angle[k], rate[k])
        if direction[k] != 0:
            torque[k] -= direction[k] * sliding_level(plant, angle[k], rate[k], direction[k])
    return torque


def mean_friction(plant: Plant, angle: np.ndarray, rate: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Torque of sliding friction (m) along a motion [N m], its mean over steps in which the rate changes steadily.

    Args:
      plant: the `Plant`.
      angle, rate: (m) of the hub in the middle of each step [rad], [rad/s].
      change: (m) of the rate over the step [rad/s].
    """
    angle, rate, change = (np.ascontiguousarray(v, dtype=float) for v in (angle, rate, change))
    return _mean_friction(plant, angle, rate, change)


@compiled
def _mean_friction(plant, angle, rate, change):
    torque = np.empty(angle.size)
    for k in range(angle.size):
        if abs(change[k]) > 1e-9:
            ends = rate[k] + 0.5 * change[k], rate[k] - 0.5 * change[k]
            mean = (_to_rate(plant, angle[k], ends[0]) - _to_rate(plant, angle[k], ends[1])) / change[k]
        else:
            mean = np.sign(rate[k]) * sliding_level(plant, angle[k], rate[k], np.sign(rate[k]))
        torque[k] = -mean
    return torque


@_inlined
def _to_rate(plant, theta, omega):
    """Integral of the friction torque over the rate, from rest to `omega` [N m rad/s]."""
    if omega > 0:
        coulomb, static = plant.coulomb_positive, plant.static_positive
    else:
        coulomb, static = plant.coulomb_negative, plant.static_negative
    fallen = 0.0
    if plant.stribeck_velocity > 0.0:
        fallen = math.erf(abs(omega) / plant.stribeck_velocity) * plant.stribeck_velocity
        fallen *= (static - coulomb) * 0.5 * math.sqrt(math.pi)
    return (coulomb + _friction_raise(plant, theta)) * abs(omega) + fallen
