"""The virtual rig against closed forms, against itself at tighter tolerance, and as a maker of campaigns."""

import ast
import math
import os
import sys
import tomllib
from pathlib import Path

import make_demo_campaign
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, simpson
from scipy.optimize import brentq

import twin.virtual_rig
from twin.commands.virtual_rig import parsed_effect
from twin.errors import InputError
from twin.virtual_rig import EFFECTS, OUTSIDE_EFFECTS, UNCERTAINTY, Rig, Sensors, make_campaign
from twin.virtual_rig.beam import (
    basis_of,
    build_link,
    clamped_modes,
    curvature_at,
    deflected_shape,
    free_modes,
    integrated_legendre,
    resting_shape,
    tip_height,
)
from twin.virtual_rig.effects import switch_on
from twin.virtual_rig.experiments import (
    Experiment,
    bang_bang,
    break_away,
    compensator,
    free_vibration,
    rigid_inertia,
    run_experiment,
    step,
)
from twin.virtual_rig.plant import STUCK, at_rest, hub_angle, simulate
from twin.virtual_rig.rig import declared_values
from twin.virtual_rig.sensors import measured

CORNER = Path(twin.virtual_rig.__file__).parent
RIG = Rig()
FRICTIONLESS = RIG._replace(
    static_positive=0.0, static_negative=0.0, coulomb_positive=0.0, coulomb_negative=0.0
)
LOSSLESS = FRICTIONLESS._replace(damping_ratio=0.0)
SENSORS = Sensors(hub_step=0.0, strain_step=0.0, torque_step=0.0)


def resting(rig, angle=0.0):
    """Returns the link and the state of a rig at rest with an unbent link."""
    link = build_link(rig)
    return link, at_rest(rig, link, angle, np.zeros(len(link.stiffness)))


def driven(rig, times, commands, angle=0.0, **options):
    """Returns hub angles (samples,) and the motion of a rig that starts at rest."""
    link, start = resting(rig, angle)
    motion = simulate(rig, link, start, times, commands, **options)
    return hub_angle(rig, link, motion.states), motion


def readings(rig, commands, angle=0.2):
    """Returns the noiseless measured channels of a driven rig, sampled at 500 Hz."""
    times = np.arange(len(commands)) / 500.0
    link = build_link(rig)
    shape = resting_shape(rig, link, angle, 9.81 * math.sin(rig.tilt))
    motion = simulate(rig, link, at_rest(rig, link, angle, shape), times, commands)
    silence = dict.fromkeys(("hub_angle", "strain_base", "strain_mid", "motor_torque"), np.zeros(len(times)))
    return measured(rig, link, SENSORS, times, motion, silence)


def slew(samples=750):
    """Returns commands (samples,) of a slew and back at 500 Hz [N m]."""
    commands = np.zeros(samples)
    commands[50:250], commands[250:400], commands[400:600] = 0.15, -0.16, -0.14
    return commands


# The link.


@pytest.mark.parametrize(
    ("modes", "published"),
    [(free_modes, [0.0, 7.2700, 18.2101, 41.9335]), (clamped_modes, [1.2430, 16.591, 41.116])],
)
def test_frequencies_are_those_of_the_exact_beam(modes, published):
    """Tolerance: the published digits."""
    omega, _ = modes(RIG, build_link(RIG))
    assert omega[: len(published)] / (2 * np.pi) == pytest.approx(published, abs=1e-4 + 5e-5 * 7)


def test_every_free_mode_has_the_declared_damping():
    link = build_link(RIG)
    omega, shapes = free_modes(RIG, link)
    losses = shapes[:-1, 1:].T @ link.damping @ shapes[:-1, 1:]
    assert losses == pytest.approx(np.diag(2 * RIG.damping_ratio * omega[1:]), abs=1e-8)


def test_clamped_link_decays_as_the_same_losses_demand():
    """0.0057 at 1.243 Hz, from the logarithmic decrement of the free vibration after release."""
    plan = free_vibration(RIG, SENSORS, np.random.default_rng(0))
    times = np.arange(len(plan.commands)) / 500.0
    link = build_link(RIG)
    motion = run_experiment(RIG, link, SENSORS, plan, times, np.zeros(len(times)))
    tip = np.array([tip_height(link, q)[0] for q in motion.states[:, : len(link.stiffness)]])
    assert tip[0] == pytest.approx(0.03, abs=1e-9)
    assert np.all(hub_angle(RIG, link, motion.states) == 0.0)
    peaks = np.flatnonzero((tip[1:-1] > tip[:-2]) & (tip[1:-1] >= tip[2:])) + 1
    late = peaks[times[peaks] > 1.0]
    decrement = np.log(tip[late[0]] / tip[late[-1]]) / (len(late) - 1)
    assert decrement / (2 * np.pi) == pytest.approx(0.00567, rel=0.02)
    assert np.mean(np.diff(times[late])) == pytest.approx(1 / 1.2430, rel=2e-3)


def test_small_static_deflection_is_the_cantilever_of_textbooks():
    link = build_link(RIG)
    shape = deflected_shape(RIG, link, 1e-4)
    # kappa = F (l - s)/EI with F = 3 EI y/l^3, for y << l.
    force = 3 * RIG.bending_stiffness * 1e-4 / RIG.length**3
    root = force * RIG.length / RIG.bending_stiffness
    legendre_at_root = (-1.0) ** np.arange(len(shape))
    assert shape @ legendre_at_root / RIG.length == pytest.approx(root, rel=1e-6)


def test_gravity_bends_the_resting_link_as_distributed_and_tip_load():
    rig = RIG._replace(tilt=1e-3, tilt_direction=math.pi / 2)
    link = build_link(rig)
    pull = 9.81 * math.sin(rig.tilt)
    tip = tip_height(link, resting_shape(rig, link, 0.0, pull))[0]
    # rho g l^4/(8 EI) + m g l^3/(3 EI).
    expected = pull * (rig.linear_density * rig.length**4 / 8 + rig.tip_mass * rig.length**3 / 3)
    assert tip == pytest.approx(expected / rig.bending_stiffness, rel=1e-4)


# Equations of motion and integrator.


def exact_free_modes(rig, count):
    """Returns angular frequencies and mass-normalised slopes at the hub of the first free modes.

    w = a (sin - sinh) beta x + b (cos - cosh) beta x + c sinh beta x solves the beam equation with w(0) = 0.
    EI w''(0) = -J0 omega^2 w'(0), EI w''(l) = Jp omega^2 w'(l), EI w'''(l) = -mp omega^2 w(l).
    """
    stiffness, length = rig.bending_stiffness, rig.length

    def derivatives(beta, x):
        s, c = np.sin(beta * x), np.cos(beta * x)
        sh, ch = np.sinh(beta * x), np.cosh(beta * x)
        rows = ((s - sh, c - ch, sh), (c - ch, -s - sh, ch), (-s - sh, -c - ch, sh), (-c - ch, s - sh, ch))
        return [beta**k * np.array(row) for k, row in enumerate(rows)]

    def conditions(beta):
        square = beta**4 * stiffness / rig.linear_density
        near, far = derivatives(beta, 0.0), derivatives(beta, length)
        return np.array(
            [
                stiffness * near[2] + rig.hub_inertia * square * near[1],
                stiffness * far[2] - rig.tip_inertia * square * far[1],
                stiffness * far[3] + rig.tip_mass * square * far[0],
            ]
        )

    grid = np.linspace(0.5, 25.0, 3000) / length
    values = [np.linalg.det(conditions(beta)) for beta in grid]
    brackets = [k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0][:count]
    omegas, slopes = [], []
    x = np.linspace(0.0, length, 2001)
    for k in brackets:
        beta = brentq(lambda b: np.linalg.det(conditions(b)), grid[k], grid[k + 1], xtol=1e-13)
        coefficients = np.linalg.svd(conditions(beta))[2][-1]
        w = coefficients @ derivatives(beta, x)[0]
        near, far = coefficients @ derivatives(beta, 0.0)[1], coefficients @ derivatives(beta, length)[1]
        mass = simpson(rig.linear_density * w**2, x=x) + rig.hub_inertia * near**2
        mass += rig.tip_mass * w[-1] ** 2 + rig.tip_inertia * far**2
        omegas.append(beta**2 * math.sqrt(stiffness / rig.linear_density))
        slopes.append(near / math.sqrt(mass))
    return np.array(omegas), np.array(slopes)


def test_response_to_a_small_torque_step_is_the_modal_solution():
    """theta = tau t^2/(2 J) + sum phi'^2 tau/omega^2 (1 - e^(-zeta omega t)(cos + ...)).

    The tolerance is what modes beyond the sixth add; deflections are too small for geometry to count.
    """
    torque, times = 1e-5, np.arange(400) / 500.0
    angle, _ = driven(FRICTIONLESS, times, np.full(400, torque), tolerance=1e-11)
    omega, slope = exact_free_modes(RIG, 6)
    assert omega[:3] / (2 * np.pi) == pytest.approx([7.27, 18.21, 41.93], abs=0.005)
    zeta = RIG.damping_ratio
    t, root = times[:, None], math.sqrt(1 - zeta**2)
    swing = np.cos(root * omega * t) + zeta / root * np.sin(root * omega * t)
    flexible = (slope**2 / omega**2 * (1 - np.exp(-zeta * omega * t) * swing)).sum(axis=1)
    expected = torque * (times**2 / (2 * rigid_inertia(RIG)) + flexible)
    assert np.abs(angle - expected).max() < 2e-4 * np.abs(expected).max()


def kinetic_and_elastic_energy(rig, link, state, points=401):
    """Returns the energy of a state [J], by Simpson's rule along the link, not the rig's own matrices."""
    n = len(link.stiffness)
    s = np.linspace(0.0, rig.length, points)
    basis = integrated_legendre(s / rig.length, n)
    psi, rate = basis @ state[:n], basis @ state[n + 1 : 2 * n + 1] + state[-1]
    vx = cumulative_simpson(-np.sin(psi) * rate, x=s, initial=0.0)
    vy = cumulative_simpson(np.cos(psi) * rate, x=s, initial=0.0)
    square = vx**2 + vy**2
    kinetic = simpson(rig.linear_density * square, x=s) + rig.tip_mass * square[-1]
    kinetic += rig.tip_inertia * rate[-1] ** 2 + rig.hub_inertia * state[-1] ** 2
    return 0.5 * (kinetic + link.stiffness @ state[:n] ** 2)


def test_energy_is_the_work_of_the_drive():
    """A fast slew through 3 rad without losses: every nonlinear term counts. Tolerance: the integrator's."""
    times = np.arange(600) / 500.0
    commands = np.where(times < 0.5, 0.2, 0.0)
    angle, motion = driven(LOSSLESS, times, commands, tolerance=1e-11)
    link = build_link(LOSSLESS)
    work = 0.2 * (angle[250] - angle[0])
    energies = [kinetic_and_elastic_energy(LOSSLESS, link, motion.states[k]) for k in range(250, 600, 50)]
    assert angle[-1] > 3.0
    assert energies == pytest.approx([work] * len(energies), rel=1e-6)


def test_tighter_tolerance_changes_nothing_visible():
    """Default against 1e-10: below a thirtieth of the sensor noise, with the same stick and slip events."""
    commands = slew(1500)
    times = np.arange(1500) / 500.0
    coarse, motion = driven(RIG, times, commands)
    fine, reference = driven(RIG, times, commands, tolerance=1e-10)
    assert np.abs(coarse - fine).max() < 1e-5
    assert list(motion.event_modes) == list(reference.event_modes)
    assert motion.event_times == pytest.approx(reference.event_times, abs=1e-5)


def test_more_functions_change_nothing_visible():
    """Seven against nine flexible modes: below the noise of 3e-4 rad."""
    times, commands = np.arange(1000) / 500.0, slew(1000)
    angles = []
    for functions in (7, 9):
        link = build_link(RIG, functions, functions + 4)
        motion = simulate(RIG, link, at_rest(RIG, link, 0.0, np.zeros(functions)), times, commands)
        angles.append(hub_angle(RIG, link, motion.states))
    assert np.abs(angles[0] - angles[1]).max() < 2e-4


def test_a_softening_link_is_held_at_any_deflection():
    rig = RIG._replace(softening=0.16, softening_curvature=0.75)
    link = build_link(rig, *basis_of(rig))
    for deflection in np.linspace(-0.12, 0.12, 49):
        shape = deflected_shape(rig, link, deflection)
        assert tip_height(link, shape)[0] == pytest.approx(deflection, abs=1e-9)


def test_a_softening_link_has_functions_enough_for_its_curvature():
    """At the gauges of a link whose tip is held 0.2 m aside, to a tenth of the noise of strains of 2e-3."""
    rig = RIG._replace(softening=0.35, softening_curvature=0.6)
    gauges = np.array([0.02, 0.21])

    def strains(functions, nodes):
        shape = deflected_shape(rig, build_link(rig, functions, nodes), 0.2)
        return 8e-4 * curvature_at(rig, gauges, functions) @ shape

    exact = strains(20, 28)
    assert np.abs(strains(*basis_of(rig)) - exact).max() < 2e-7
    assert np.abs(strains(*basis_of(RIG)) - exact).max() > 1e-6


# Friction.


def test_hub_holds_exactly_below_the_static_level():
    angle, motion = driven(RIG, np.arange(500) / 500.0, np.full(500, 0.0649), angle=0.3)
    assert np.all(angle == 0.3)
    assert len(motion.event_times) == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_hub_breaks_away_where_the_ramp_passes_the_static_level(sign):
    times = np.arange(2500) / 500.0
    commands = sign * 0.02 * times
    _, motion = driven(RIG, times, commands)
    first = times[np.argmax(np.abs(commands) > RIG.static_positive)]
    assert motion.event_times[0] == pytest.approx(first, abs=1e-9)
    assert motion.event_modes[0] == sign


def test_slewed_hub_sticks_at_a_zero_of_its_velocity_and_stays():
    times = np.arange(1500) / 500.0
    commands = np.select([times < 0.3, times < 0.65], [0.12, -0.12])
    angle, motion = driven(RIG, times, commands)
    assert motion.event_modes[-1] == STUCK
    after = times > motion.event_times[-1]
    assert np.ptp(angle[after]) == 0.0
    assert np.all(motion.states[after, -1] == 0.0)


def test_sliding_hub_loses_what_coulomb_friction_takes():
    """Mean deceleration of the free rig is tau_c/J, with the link's swing averaged out over periods."""
    rig = RIG._replace(static_positive=0.0055, static_negative=0.0055)
    times = np.arange(1500) / 500.0
    link, start = resting(rig)
    start[-1] = 2.0  # all points of the straight link turn at 2 rad/s
    motion = simulate(rig, link, start, times, np.zeros(1500))
    rate = motion.states[:, -1]
    spread = np.polyfit(times, rate, 1)[0]
    assert spread == pytest.approx(-rig.coulomb_positive / rigid_inertia(rig), rel=0.02)


# Effects.

STRONG = {
    "viscous-friction": {"viscous": 0.003},
    "stribeck-friction": {"stribeck_velocity": 0.5},
    "asymmetric-friction": {"coulomb_positive": 0.015},
    "position-dependent-friction": {"amplitude": 0.02, "order": 3, "phase": 0.4},
    "cable-torsion": {"stiffness": 0.02, "rest_angle": -0.1},
    "cogging": {"amplitude": 0.01, "order": 5, "phase": 0.9},
    "torque-gain": {"gain": 0.9},
    "torque-bias": {"bias": 0.008},
    "actuator-lag": {"time_constant": 0.02},
    "actuator-delay": {"delay": 0.013},
    "backlash": {"gap": 0.02, "motor_inertia_share": 0.4},
    "gravity-tilt": {"tilt": 0.01, "direction": 0.7},
    "periodic-disturbance": {"frequency": 3.0, "amplitude": 0.02, "phase": 0.3},
    "payload-mass": {"tip_mass": 0.14},
    "stiffness-loss": {"bending_stiffness": 0.22},
    "softening-stiffness": {"softening": 0.3, "curvature": 0.8},
    "torsional-mode": {"frequency": 28.0, "damping_ratio": 0.01, "inertia_share": 0.15},
    "root-compliance": {"stiffness": 20.0},
    "air-drag": {"coefficient": 0.05},
    "air-pad-drag": {"viscous": 0.03},
    "dead-zone": {"half_width": 0.02},
    "hub-sensor-gain": {"gain": 0.97},
    "hub-sensor-nonlinearity": {"amplitude": 0.02, "order": 2, "phase": 1.5},
    "strain-gain": {"gain_base": 0.95, "gain_mid": 1.04},
    "strain-drift": {"rate_base": 2e-5, "rate_mid": -1e-5},
    "sensor-delay": {"delay": 0.007},
    "strain-amplifier-clips": {"level": 2e-4},
    "dead-band": {"width": 0.145},
    "hard-stop": {"angle": 0.5, "stiffness": 5.0, "damping": 0.01},
    "warming-friction": {"rise": 0.01, "time_constant": 5.0},
    "shaking-base": {"amplitude": 0.3, "frequency": 2.0, "phase": 0.0},
    "saturating-motor": {"loss": 0.2},
    "hardening-cable": {"stiffness": 0.1},
    "warming-link": {"loss": 0.1, "time_constant": 2.0},
    "motor-in-strain": {"base": 3e-4, "mid": -3e-4},
    "bristles": {"stiffness": 10.0},
    "loose-payload": {"share": 0.4, "gap": 4e-3},
    "knocks": {"torque": 0.2, "period": 0.6},
}
NEUTRAL = {
    "viscous-friction": {"viscous": 0.0},
    "stribeck-friction": {"stribeck_velocity": 0.0},
    "asymmetric-friction": {},
    "position-dependent-friction": {"amplitude": 0.0},
    "cable-torsion": {"stiffness": 0.0},
    "cogging": {"amplitude": 0.0},
    "torque-gain": {"gain": 1.0},
    "torque-bias": {"bias": 0.0},
    "dead-zone": {"half_width": 0.0},
    "actuator-lag": {"time_constant": 0.0},
    "actuator-delay": {"delay": 0.0},
    "backlash": {"gap": 0.0},
    "gravity-tilt": {"tilt": 0.0},
    "periodic-disturbance": {"amplitude": 0.0},
    "payload-mass": {"tip_mass": RIG.tip_mass},
    "stiffness-loss": {"bending_stiffness": RIG.bending_stiffness},
    "softening-stiffness": {"softening": 0.0},
    "torsional-mode": {"inertia_share": 0.0},
    "root-compliance": {"stiffness": math.inf},
    "air-drag": {"coefficient": 0.0},
    "air-pad-drag": {"viscous": 0.0},
    "hub-sensor-gain": {"gain": 1.0},
    "hub-sensor-nonlinearity": {"amplitude": 0.0},
    "strain-gain": {"gain_base": 1.0, "gain_mid": 1.0},
    "strain-drift": {"rate_base": 0.0, "rate_mid": 0.0},
    "sensor-delay": {"delay": 0.0},
    "strain-amplifier-clips": {"level": math.inf},
    "dead-band": {"width": 0.0},
    "hard-stop": {"angle": math.inf},
    "warming-friction": {"rise": 0.0},
    "shaking-base": {"amplitude": 0.0},
    "saturating-motor": {"loss": 0.0},
    "hardening-cable": {"stiffness": 0.0},
    "warming-link": {"loss": 0.0},
    "motor-in-strain": {"base": 0.0, "mid": 0.0},
    "bristles": {"stiffness": math.inf},
    "loose-payload": {"gap": 0.0},
    "knocks": {"torque": 0.0},
}


def test_every_effect_is_tested():
    assert set(STRONG) == set(NEUTRAL) == set(EFFECTS | OUTSIDE_EFFECTS)


@pytest.fixture(scope="module")
def baseline():
    return readings(RIG, slew())


@pytest.mark.parametrize("name", STRONG)
def test_neutral_effect_is_the_baseline(name, baseline):
    """The size alone makes an effect: its other parameters may have any value."""
    channels = readings(switch_on(RIG, {name: STRONG[name] | NEUTRAL[name] if NEUTRAL[name] else {}}), slew())
    for channel, values in baseline.items():
        assert np.array_equal(channels[channel], values), channel


@pytest.mark.parametrize("name", STRONG)
def test_strong_effect_is_seen_above_the_noise(name, baseline):
    channels = readings(switch_on(RIG, {name: STRONG[name]}), slew())
    noise = {"hub_angle": 3e-4, "strain_base": 2e-6, "strain_mid": 2e-6, "motor_torque": 1e-3}
    change = max(np.abs(channels[c] - baseline[c]).max() / sigma for c, sigma in noise.items())
    assert change > 10
    assert all(np.isfinite(values).all() for values in channels.values())


def test_cable_swings_the_hub_like_a_torsion_pendulum():
    """omega^2 = k/J, with the link's tip in series: 1/k + l/(3 EI)."""
    rig = FRICTIONLESS._replace(cable_stiffness=0.02, cable_rest_angle=0.1)
    times = np.arange(4000) / 500.0
    angle, _ = driven(rig, times, np.zeros(4000), angle=0.15)
    crossings = times[1:][np.diff(np.sign(angle - 0.1)) != 0]
    period = 2 * np.mean(np.diff(crossings))
    compliance = 1 / 0.02 + rig.length / (3 * rig.bending_stiffness)
    assert period == pytest.approx(2 * np.pi * math.sqrt(rigid_inertia(rig) * compliance), rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "rate"),
    [
        ({"viscous_friction": 0.003}, 0.003),
        ({"air_pad_drag": 0.02}, 0.02 * RIG.length**2),
    ],
)
def test_viscous_losses_slow_a_turning_rig_exponentially(changes, rate):
    """J omega_t = -c omega; the link bends by little."""
    rig = FRICTIONLESS._replace(**changes)
    times = np.arange(1500) / 500.0
    link, start = resting(rig)
    start[-1] = 1.0
    motion = simulate(rig, link, start, times, np.zeros(1500))
    slope = np.polyfit(times, np.log(motion.states[:, -1]), 1)[0]
    assert slope == pytest.approx(-rate / rigid_inertia(rig), rel=0.02)


def test_quadratic_drag_slows_a_turning_rig_hyperbolically():
    """J omega_t = -c l^3 omega^2: 1/omega grows linearly."""
    rig = FRICTIONLESS._replace(air_drag=0.05)
    times = np.arange(1500) / 500.0
    link, start = resting(rig)
    start[-1] = 2.0
    motion = simulate(rig, link, start, times, np.zeros(1500))
    slope = np.polyfit(times, 1 / motion.states[:, -1], 1)[0]
    assert slope == pytest.approx(0.05 * RIG.length**3 / rigid_inertia(rig), rel=0.02)


def test_softening_lowers_the_resonance_of_large_motions_only():
    """At curvatures far below kappa_0 the link is linear; far above, EI is (1 - s) EI."""
    rig = RIG._replace(softening=0.3, softening_curvature=0.8)
    link = build_link(rig)
    stiff = deflected_shape(RIG, build_link(RIG), 1e-5)
    assert deflected_shape(rig, link, 1e-5) == pytest.approx(stiff, rel=1e-3, abs=1e-12)
    soft = RIG._replace(softening=0.3, softening_curvature=1e-6)
    force_ratio = _holding_force(soft) / _holding_force(RIG)
    assert force_ratio == pytest.approx(0.7, rel=1e-3)


def _holding_force(rig, deflection=0.01):
    """Returns the tip force that holds a deflection, by virtual work on the first coordinate [N]."""
    link = build_link(rig)
    shape = deflected_shape(rig, link, deflection)
    lost = rig.softening if rig.softening_curvature < 1e-3 else 0.0
    return link.stiffness[0] * shape[0] * (1 - lost) / tip_height(link, shape)[1][0]


@pytest.mark.parametrize("delay", [0.004, 0.0153])
def test_actuator_delay_shifts_the_response(delay, baseline):
    channels = readings(RIG._replace(actuator_delay=delay), slew())
    times = np.arange(750) / 500.0
    shifted = np.interp(times - delay, times, baseline["hub_angle"])
    # Linear interpolation between samples is off by h^2/8 of the angular acceleration.
    assert np.abs(channels["hub_angle"] - shifted).max() < 2e-4


def test_delays_of_actuator_and_sensors_look_alike_in_open_loop():
    late = readings(RIG._replace(actuator_delay=0.0153), slew())
    seen_late = readings(RIG._replace(sensor_delay=0.0153), slew())
    for channel in ("hub_angle", "strain_base", "strain_mid", "motor_torque"):
        assert np.abs(late[channel] - seen_late[channel]).max() < 1e-5


def test_motor_torque_is_what_the_drive_delivers():
    """Gain after the limit, then a first-order lag towards the held command."""
    rig = RIG._replace(torque_gain=0.9, actuator_lag=0.02)
    commands = np.full(200, 0.5)
    torque = readings(rig, commands)["motor_torque"]
    expected = 0.9 * RIG.torque_limit * (1 - np.exp(-np.arange(200) / 500.0 / 0.02))
    assert torque == pytest.approx(expected, abs=1e-12)


def test_backlash_leaves_the_hub_alone_until_the_gap_is_closed():
    rig = RIG._replace(backlash_gap=0.03, backlash_motor_share=0.4)
    angle, motion = driven(rig, np.arange(200) / 500.0, np.full(200, 0.1))
    # Half the gap at tau/(share J0), from the middle; contact itself takes a few ms to load the hub.
    closed = math.sqrt(2 * 0.015 * 0.4 * RIG.hub_inertia / 0.1)
    assert motion.event_times[0] == pytest.approx(closed, abs=0.004)
    assert motion.event_times[0] > closed
    assert angle[-1] > 0.01


def test_hard_stop_turns_the_hub_back():
    rig = RIG._replace(stop_angle=0.3, stop_stiffness=50.0)
    angle, _ = driven(rig, np.arange(1000) / 500.0, np.full(1000, 0.1))
    assert 0.3 < angle.max() < 0.33


def test_bristles_give_under_a_torque_that_does_not_break_the_hub_away():
    rig = RIG._replace(bristle_stiffness=10.0)
    angle, motion = driven(rig, np.arange(8000) / 500.0, np.linspace(0.0, 0.1, 8000).clip(max=0.05))
    assert len(motion.event_times) == 0
    assert angle[-1] == pytest.approx(0.05 / 10.0, rel=1e-3)


def test_a_hub_swings_on_its_bristles_where_friction_has_stopped_it():
    rig = RIG._replace(bristle_stiffness=10.0)
    commands = np.r_[np.full(100, 0.1), np.full(100, -0.1), np.zeros(9800)]
    angle, motion = driven(rig, np.arange(10000) / 500.0, commands)
    assert motion.event_modes[-1] == 0
    assert motion.event_times[-1] < 2.0
    early, late = angle[1000:2000], angle[-1000:]
    assert late.mean() == pytest.approx(early.mean(), abs=1e-3)
    assert np.ptp(late) < 0.6 * np.ptp(early)


def test_payload_that_is_free_across_the_link_is_no_load_to_it():
    rig = LOSSLESS._replace(loose_share=0.3, loose_gap=10.0)
    times = np.arange(300) / 500.0
    commands = np.where(times < 0.1, 2e-3, 0.0)
    angle, _ = driven(rig, times, commands)
    lighter, _ = driven(LOSSLESS._replace(tip_mass=0.7 * LOSSLESS.tip_mass), times, commands)
    assert angle == pytest.approx(lighter, rel=1e-3, abs=1e-6)


def test_knocks_are_as_many_as_periods_and_seem_irregular():
    rig = RIG._replace(knock_torque=0.3, knock_period=0.5)
    _, motion = driven(rig, np.arange(2000) / 500.0, np.zeros(2000))
    starts = motion.event_times[np.diff(motion.event_modes, prepend=0) != 0]
    assert {int(t / 0.5) for t in starts} == set(range(8))
    assert np.std(starts % 0.5) > 0.05


# Experiments and campaigns.


def test_compensator_has_the_gain_and_poles_of_the_paper():
    """R(0) = 5/1500 N m/deg; the bilinear rule keeps it and puts the poles at (2 f + p)/(2 f - p)."""
    b0, b1, b2, a1, a2 = compensator(500.0)
    assert (b0 + b1 + b2) / (1 + a1 + a2) == pytest.approx(5 / 1500, rel=1e-9)
    assert sorted(np.roots([1.0, a1, a2])) == pytest.approx([(1000 - 300) / 1300, (1000 - 5) / 1005])


def test_closed_loop_step_arrives():
    """The paper's loop overshoots and ends near its reference; break-away friction leaves some degrees."""
    plan = step(RIG, SENSORS, np.random.default_rng(1))
    times = np.arange(len(plan.commands)) / 500.0
    link = build_link(RIG)
    motion = run_experiment(RIG, link, SENSORS, plan, times, np.zeros(len(times)))
    error = np.degrees(hub_angle(RIG, link, motion.states)[-1] - plan.reference[-1])
    assert abs(error) < 25.0
    assert np.abs(motion.commands).max() > 0.05


def test_break_away_ends_each_ramp_where_the_hub_moved():
    plan = break_away(RIG, SENSORS, np.random.default_rng(3))
    times = np.arange(len(plan.commands)) / 500.0
    link = build_link(RIG)
    motion = run_experiment(RIG, link, SENSORS, plan, times, np.zeros(len(times)))
    assert RIG.static_positive < np.abs(motion.commands[: plan.ramps[0][1]]).max() < 0.068
    assert motion.commands.max() > 0.02
    assert motion.commands.min() < -0.02


def short_plan(start=0.1):
    """Returns two short experiments."""
    pulse = Experiment("pulse", "bang-bang", "fit", start, slew(400))
    release = Experiment("release", "free-vibration", "holdout", 0.0, np.zeros(200), tip_deflection=0.02)
    return [pulse, release]


def folder_bytes(folder):
    """Returns the contents of all files of a folder by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_same_seed_gives_the_same_files(tmp_path):
    effects = {"cogging": {"amplitude": 0.01}}
    options = {
        "experiments": short_plan(),
        "perturb": 1.0,
        "dirty": ("spikes", "missing-fields"),
        "name": "x",
    }
    truths = [make_campaign(tmp_path / name, effects, seed, **options) for name, seed in (("a", 3), ("b", 3))]
    other = make_campaign(tmp_path / "c", effects, 4, **options)
    assert truths[0] == truths[1] != other
    assert folder_bytes(tmp_path / "a") == folder_bytes(tmp_path / "b")
    assert folder_bytes(tmp_path / "a")["pulse.csv"] != folder_bytes(tmp_path / "c")["pulse.csv"]


@pytest.mark.slow
def test_campaign_declares_the_rig_but_not_its_effects(tmp_path):
    truth = make_campaign(tmp_path / "rig", {"viscous-friction": {"viscous": 0.004}}, 11, perturb=0.5)
    files = folder_bytes(tmp_path / "rig")
    text = files["campaign.toml"].decode()
    declared = tomllib.loads(text)
    assert "viscous" not in text
    assert declared["parameters"] == pytest.approx(declared_values(RIG))
    assert declared["uncertainty"] == UNCERTAINTY
    assert {r["file"] for r in declared["recordings"]} | {"campaign.toml"} == set(files)
    assert {r["role"] for r in declared["recordings"]} == {"fit", "holdout"}
    assert any(r["clamped"] and r["initial_tip_deflection"] == 0.03 for r in declared["recordings"])
    assert any(r["loop"] == "closed" and r["role"] == "holdout" for r in declared["recordings"])
    assert truth.effects == {"viscous-friction": {"viscous": 0.004}}
    for name, sigma in UNCERTAINTY.items():
        assert 0 < abs(truth.true[name] / truth.declared[name] - 1) <= sigma
    for recording in declared["recordings"]:
        header = files[recording["file"]].decode().splitlines()[0].split(",")
        assert set(header) - {"time"} <= set(declared["channels"])
        assert ("hub_angle" in header) != recording["clamped"]


def table(path):
    """Returns a recording's columns by name; a missing field is nan."""
    return np.genfromtxt(path, delimiter=",", names=True)


def test_noise_and_steps_of_the_sensors_are_as_declared(tmp_path):
    still = Experiment("still", "rest", "fit", 0.25, np.zeros(4000))
    make_campaign(tmp_path / "rig", {}, 1, experiments=[still])
    data = table(tmp_path / "rig" / "still.csv")
    assert data["hub_angle"].mean() == pytest.approx(0.25, abs=3e-5)
    assert data["hub_angle"].std() == pytest.approx(3e-4, rel=0.05)
    assert data["strain_mid"].std() == pytest.approx(2e-6, rel=0.05)
    assert np.abs(data["hub_angle"] * 1e4 - np.rint(data["hub_angle"] * 1e4)).max() < 1e-6


def test_dirt_is_in_the_data_and_in_the_truth(tmp_path):
    plain = {"experiments": short_plan(), "motor_torque": False}
    make_campaign(tmp_path / "clean", {}, 5, **plain)
    dirty = ("spikes", "missing-fields", "dropped-rows")
    truth = make_campaign(tmp_path / "dirty", {}, 5, **plain, dirty=dirty)
    clean, soiled = table(tmp_path / "clean" / "pulse.csv"), table(tmp_path / "dirty" / "pulse.csv")
    assert "motor_torque" not in clean.dtype.names
    assert len(soiled) == len(clean) - len(truth.defects["pulse.csv"]["dropped-rows"])
    assert any(np.isnan(soiled[name]).any() for name in ("hub_angle", "strain_base", "strain_mid"))
    kept = np.isin(clean["time"], soiled["time"])
    off = np.abs(soiled["strain_base"] - clean["strain_base"][kept])
    off_hub = np.abs(soiled["hub_angle"] - clean["hub_angle"][kept])
    assert np.nanmax(off) > 5e-5 or np.nanmax(off_hub) > 7e-3 or len(truth.defects["pulse.csv"]["spikes"]) < 3
    # A held command still rules the time up to the next row.
    changed = np.append(True, np.diff(clean["torque_command"]) != 0)
    assert kept[changed].all()


def test_recording_ends_where_the_hub_leaves_the_range_of_its_sensor(tmp_path):
    runaway = Experiment("runaway", "step", "fit", 2.0, np.full(1000, 0.1))
    make_campaign(tmp_path / "rig", {}, 1, experiments=[runaway])
    data = table(tmp_path / "rig" / "runaway.csv")
    assert len(data) < 1000
    assert data["hub_angle"][-1] == pytest.approx(2.6, abs=0.02)


def test_jitter_moves_the_sample_times_and_keeps_them_in_order(tmp_path):
    make_campaign(tmp_path / "rig", {}, 5, experiments=short_plan(), dirty=("jitter",))
    steps = np.diff(table(tmp_path / "rig" / "pulse.csv")["time"])
    assert steps.min() > 0.0005
    assert steps.std() > 1e-4


def test_truth_is_written_outside_the_campaign_only(tmp_path):
    plan = short_plan()[1:]
    make_campaign(tmp_path / "rig", {}, 1, experiments=plan, truth_file=tmp_path / "truth.json")
    assert (tmp_path / "truth.json").is_file()
    with pytest.raises(InputError, match="inside the campaign"):
        make_campaign(tmp_path / "b", {}, 1, experiments=plan, truth_file=tmp_path / "b" / "truth.json")


def test_full_folder_is_not_overwritten_unless_forced(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        make_campaign(tmp_path, {}, 1, experiments=short_plan()[1:])
    make_campaign(tmp_path, {}, 1, experiments=short_plan()[1:], force=True)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_unwritable_places_are_found_before_the_simulation(tmp_path, monkeypatch):
    monkeypatch.setattr("twin.virtual_rig.campaign_writer._record", lambda *_: pytest.fail("simulated"))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="it is a file"):
        make_campaign(tmp_path / "file" / "rig", {}, 1)
    for truth, message in (("none/truth.json", "there is no folder"), ("file/truth.json", "no folder")):
        with pytest.raises(InputError, match=message):
            make_campaign(tmp_path / "rig", {}, 1, truth_file=tmp_path / truth)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_campaign_is_written_whole_over_what_a_killed_process_left(tmp_path, monkeypatch):
    order, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda old, new: order.append(new.name) or replace(old, new))
    (tmp_path / f".twin-{os.getpid()}-00000000-00000000.tmp").write_text("half")
    make_campaign(tmp_path, {}, 1, experiments=short_plan()[1:], name='a "b" \\ {{')
    assert order[-1] == "campaign.toml"
    assert sorted(order) == sorted(path.name for path in tmp_path.iterdir())
    assert tomllib.loads((tmp_path / "campaign.toml").read_text())["name"] == 'a "b" \\ {{'


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"viscous-fricton": {}}, "did you mean 'viscous-friction'"),
        ({"backlash": {"width": 1.0}}, "expected one of: gap, motor_inertia_share"),
        ({"torque-gain": {"gain": math.nan}}, "gain is nan"),
        ({"backlash": {"gap": -5}}, "backlash: gap is -5; expected 0 to 1e"),
        ({"payload-mass": {"tip_mass": -1}}, "payload-mass: tip_mass is -1"),
        ({"stiffness-loss": {"bending_stiffness": 0}}, "bending_stiffness is 0"),
        ({"cogging": {"amplitude": 1e300}}, r"amplitude is 1e\+300; expected 0 to 1e"),
    ],
)
def test_wrong_effects_are_named(tmp_path, effects, message):
    with pytest.raises(InputError, match=message):
        make_campaign(tmp_path / "rig", effects, 0)


@pytest.mark.parametrize(
    ("seed", "perturb", "message"),
    [
        (-1, 0.0, "seed is -1"),
        (0, math.nan, "perturb is nan"),
        (0, -1.0, "perturb is -1"),
        (0, 1e9, "expected 0 to 4"),
    ],
)
def test_wrong_numbers_are_named(tmp_path, seed, perturb, message):
    with pytest.raises(InputError, match=message):
        make_campaign(tmp_path / "rig", {}, seed, perturb=perturb)
    assert not list(tmp_path.iterdir())


def test_command_line_makes_a_campaign(twin, monkeypatch):
    assert parsed_effect("cable-torsion:stiffness=0.014,rest_angle=-0.1") == (
        "cable-torsion",
        {"stiffness": 0.014, "rest_angle": -0.1},
    )
    monkeypatch.setattr(
        "twin.virtual_rig.campaign_writer.planned_campaign",
        lambda rig, sensors, generator: [bang_bang(rig, sensors, generator, 20.0)],
    )
    effect = ["--effect", "viscous-friction:viscous=0.003"]
    made = twin("virtual-rig", "--out", "rig", *effect, "--seed", 2, "--perturb", 1, "--truth", "truth.json")
    assert made == (0, "rig: campaign 'rig', effects: viscous-friction\n", "")
    assert Path("rig/bang-bang-20.csv").is_file()
    assert '"viscous": 0.003' in Path("truth.json").read_text()
    assert twin("virtual-rig", "--out", "rig", *effect)[0] == 2
    code, _, error = twin("virtual-rig", "--out", "other", "--effect", "torque-gain:gain=loud")
    assert code == 2
    assert "expected parameter=number" in error


def test_demo_campaign_is_small_and_from_its_script():
    folder = Path(twin.__file__).parent / "data" / "demo-rig"
    assert folder == make_demo_campaign.FOLDER
    files = folder_bytes(folder)
    assert sum(map(len, files.values())) < 3e6
    assert not any(name.encode() in files["campaign.toml"] for name in make_demo_campaign.EFFECTS)


def test_corner_shares_no_model_code_with_the_twin():
    shared = ("twin.errors", "twin.terminal", "twin.files.compiled", "twin.files.whole")  # no models
    allowed = {"numpy", "scipy"} | set(sys.stdlib_module_names)
    for path in CORNER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0
                names = [node.module]
            for name in names:
                own = name in shared or name.startswith("twin.virtual_rig")
                assert own or name.split(".")[0] in allowed, f"{path.name} imports {name}"
