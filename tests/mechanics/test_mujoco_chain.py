"""MuJoCo's chain against the compiled equations of motion of `planar`, which share no code with it."""

import mujoco
import numpy as np
import pytest
from plants import BIAS, changed, torque_of

from twin.mechanics import beam, planar
from twin.mechanics.chain import build
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import declared_plant
from twin.rigs import preset

RIG = preset("bossi2009")
CHAIN = build(RIG)
PLANT = declared_plant(RIG, CHAIN)
SIZE = len(CHAIN.lengths)
REST = np.zeros(SIZE)
STEP = 5e-4

MECHANISMS = {
    "none": {},
    "viscous": {"torques": (torque_of("viscous-friction", viscous=0.004),)},
    "cable": {"torques": (torque_of("cable-torsion", stiffness=0.03, rest_angle=0.3),)},
    "two springs": {
        "torques": (
            torque_of("cable-torsion", stiffness=0.03, rest_angle=0.3),
            torque_of("cable-torsion", stiffness=0.01, rest_angle=-0.8),
        )
    },
    "bias": {"torques": (BIAS,)},
    "bias and cable": {"torques": (BIAS, torque_of("cable-torsion", stiffness=0.03, rest_angle=0.3))},
    "cogging": {"torques": (torque_of("cogging", amplitude=0.01, order=12.0, phase=0.3),)},
    "gravity": {"link": {"gravity_x": 0.05, "gravity_y": -0.1}},
    "linear drag": {"link": {"drag_linear": 0.05}},
    "quadratic drag": {"link": {"drag_quadratic": 0.05}},
    "both drags": {"link": {"drag_linear": 0.03, "drag_quadratic": 0.05}},
    "stribeck": {"friction": {"stribeck_velocity": 0.05}},
    "position-dependent friction": {"friction": {"amplitude": 0.01, "order": 3.0, "phase": 0.2}},
    "asymmetric friction": {"friction": {"coulomb_negative": 0.008, "static_negative": 0.05}},
    "disturbance": {
        "torques": (torque_of("periodic-disturbance", amplitude=0.02, frequency=5.0, phase=0.3),)
    },
    "lag": {"motor": {"lag": 0.01}},
    "softening": {"link": {"softening": 0.3, "softening_curvature": 2.0}},
}


def _slew(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.array([0.0, 0.25, 0.5]), np.array([0.15, -0.15, 0.0]), np.arange(0.0, duration, 2e-3)


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_slew_with_sticking_agrees(mechanism):
    plant = changed(PLANT, **MECHANISMS[mechanism])
    # Friction that falls steeply with the rate takes half the step: with the whole one, both are off by some 6e-5.
    step = STEP / 2 if mechanism == "stribeck" else STEP
    run = (*_slew(1.0), REST, REST, 0, False, step)
    angles, rates, modes = planar.simulate(plant, *run)
    found = MujocoChain(RIG, CHAIN, plant, MECHANISMS[mechanism].get("torques", ())).simulate(*run)
    assert np.any(modes[100:] == 0)
    assert np.any(modes[100:] != 0)
    # `planar` locates an event to 1e-7 s, in which a rate of 1e-5 rad/s comes or goes.
    np.testing.assert_allclose(found[0], angles, atol=3e-5)
    # One sample may fall on either side of an event.
    assert np.mean(found[2] != modes) < 0.005


@pytest.mark.parametrize("mechanism", ["none", "stribeck", "lag"])
@pytest.mark.parametrize("period", [1e-3, 5e-4])
def test_rows_between_two_checks_are_those_of_a_run_with_fewer(mechanism, period):
    plant = changed(PLANT, **MECHANISMS[mechanism])
    engine = MujocoChain(RIG, CHAIN, plant)
    commands = _slew(1.0)[:2]
    few, many = (
        engine.simulate(*commands, np.arange(0.0, 1.0, p), REST, REST, 0, False, STEP) for p in (2e-3, period)
    )
    every = round(2e-3 / period)
    # Behind an event, the steps to the next row are cut differently.
    np.testing.assert_allclose(many[0][::every], few[0], atol=1e-5)
    assert np.mean(many[2][::every] != few[2]) < 0.005
    assert np.abs(np.diff(many[0], axis=0)).max() < 1.1 * period * np.abs(many[1]).max()


def test_what_a_lag_remembers_was_commanded_long_before():
    plant = PLANT.with_motor(lag=0.05)
    command = np.array([-1e3, 0.0]), np.array([0.1, -0.1])
    moving = (np.arange(0.0, 0.1, 2e-3), REST, np.full(SIZE, 1.0), 1, False, STEP)
    remembered, started = (
        planar.simulate(plant, *given, *moving)[0] for given in (command, [c[1:] for c in command])
    )
    assert remembered[-1, 0] > started[-1, 0] + 0.01
    np.testing.assert_allclose(
        MujocoChain(RIG, CHAIN, plant).simulate(*command, *moving)[0], remembered, atol=3e-5
    )


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_clamped_free_vibration_agrees(mechanism):
    plant = changed(PLANT, **MECHANISMS[mechanism])
    bent = 0.4 + np.cumsum(np.append(0.0, np.linspace(0.03, 0.01, SIZE - 1)))
    run = (*_slew(0.4), bent, REST, 0, True, STEP)
    angles, rates, _ = planar.simulate(plant, *run)
    found = MujocoChain(RIG, CHAIN, plant, MECHANISMS[mechanism].get("torques", ())).simulate(*run)
    np.testing.assert_allclose(found[0], angles, atol=1e-9)
    np.testing.assert_allclose(found[1], rates, atol=1e-7)


def test_released_hub_agrees():
    frictionless = PLANT.with_friction(
        static_positive=0.0, static_negative=0.0, coulomb_positive=0.0, coulomb_negative=0.0
    )
    bent = np.linspace(0.0, 0.3, SIZE)
    run = (np.array([0.0]), np.array([0.0]), np.arange(0, 0.5, 2e-3), bent, REST, -1, False, STEP)
    angles = planar.simulate(frictionless, *run)[0]
    np.testing.assert_allclose(MujocoChain(RIG, CHAIN, frictionless).simulate(*run)[0], angles, atol=3e-5)


def test_steps_of_a_controller_are_those_of_a_run():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    command_time, command, out = _slew(0.7)
    angles, rates, modes = engine.simulate(command_time, command, out, REST, REST)
    engine.reset(REST)
    for k, time in enumerate(out[:-1]):
        held = command[np.searchsorted(command_time, time + 1e-9, side="right") - 1]
        engine.advance(held, out[k + 1] - time)
        assert engine.mode == modes[k + 1]
    assert engine.time == pytest.approx(out[-1])
    np.testing.assert_allclose(engine.angles, angles[-1], atol=1e-6)
    np.testing.assert_allclose(engine.rates, rates[-1], atol=1e-4)
    np.testing.assert_allclose(np.cumsum(engine.joints), engine.angles)


def test_run_continues_from_the_state_of_another():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    command_time, command, out = _slew(0.6)
    angles, rates, modes = engine.simulate(command_time, command, out, REST, REST)
    rest_of_it = (out[150:], angles[150], rates[150], int(modes[150]))
    np.testing.assert_allclose(
        engine.simulate(command_time, command, *rest_of_it)[0], angles[150:], atol=1e-6
    )


def test_hub_below_break_away_does_not_creep():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    engine.advance(0.06, 60.0)
    assert abs(engine.angles[0]) < 1e-6
    assert engine.mode == 0


def test_slow_ramp_breaks_away_at_the_static_level():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    torque = 0.0645
    while engine.mode == 0:
        torque += 1e-6
        engine.advance(torque, 1e-2)
    assert torque == pytest.approx(0.0650, abs=2e-4)


def test_halving_the_step_leaves_the_slew_where_it_was():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    half = np.sqrt(np.pi / 2 * beam.rigid_inertia(RIG) / 0.15)
    run = (half * np.arange(3.0), np.array([0.15, -0.15, 0.0]), np.array([0.0, 4 * half]), REST, REST)
    finals = [engine.simulate(*run, h_max=h)[0][-1, 0] for h in (7e-4, 3.5e-4)]
    assert abs(finals[0] - finals[1]) < 1e-4


def test_sparse_output_does_not_miss_a_stick():
    engine = MujocoChain(RIG, CHAIN, PLANT)
    command_time, command, out = _slew(1.5)
    dense = engine.simulate(command_time, command, out, REST, REST)[0]
    sparse = engine.simulate(command_time, command, out[[0, -1]], REST, REST)[0]
    assert sparse[-1, 0] == pytest.approx(dense[-1, 0], abs=1e-4)


def test_callback_is_gone_after_a_run():
    engine = MujocoChain(RIG, CHAIN, PLANT.with_motor(lag=0.01))
    engine.advance(0.1, 0.01)
    assert mujoco.get_mjcb_control() is None
