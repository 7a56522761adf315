"""A torsional mode and a motor with play: closed forms, and both engines' files."""

import math

import mujoco
import numpy as np
import pytest
from plants import changed, torque_of

from twin.mechanics import mjcf, planar
from twin.mechanics.chain import build
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import CONTACT_DAMPING, CONTACT_STEP, declared_plant
from twin.residuals.filters import low_passed
from twin.rigs import preset

RIG = preset("bossi2009").replace(static_friction=0.0, coulomb_friction=0.0)
CHAIN = build(RIG, 6)
PLANT = declared_plant(RIG, CHAIN)
REST = np.zeros(len(CHAIN.lengths))
SHARE = 0.4
MOTOR = SHARE * RIG["hub_inertia"]
NO_DRIVE = (np.zeros(1), np.zeros(1))


def torsional(frequency=25.0, ratio=0.05, share=0.2):
    inertia, omega = share * RIG["hub_inertia"], 2 * math.pi * frequency
    return PLANT.with_torsion(inertia, inertia * omega**2, 2 * ratio * omega * inertia)


def test_torsional_mode_rings_at_its_frequency_on_a_locked_hub():
    frequency, ratio, angle = 25.0, 0.05, 0.01
    plant = torsional(frequency, ratio)
    time = np.arange(0, 0.2, 1e-3)
    phi = np.append(REST, angle)
    found, _, _ = planar.simulate(plant, *NO_DRIVE, time, phi, 0 * phi, 0, True, 5e-4)
    decay, turn = ratio * 2 * math.pi * frequency, math.sqrt(1 - ratio**2) * 2 * math.pi * frequency
    exact = angle * np.exp(-decay * time) * (np.cos(turn * time) + decay / turn * np.sin(turn * time))
    np.testing.assert_allclose(found[:, -1], exact, atol=1e-6)


@pytest.mark.parametrize("plant", [torsional(), PLANT.with_backlash(0.02, MOTOR)])
def test_inertia_of_the_hub_is_shared_not_added(plant):
    assert np.trace(plant.link.inertia) == pytest.approx(np.trace(PLANT.link.inertia))


def test_extras_keep_their_places_whichever_comes_first():
    oscillator, motor = (1e-4, 2.5, 1e-3), (0.02, MOTOR)
    one = PLANT.with_torsion(*oscillator).with_backlash(*motor)
    other = PLANT.with_backlash(*motor).with_torsion(*oscillator)
    for a, b in zip((*one.link, *one.motor), (*other.link, *other.motor), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)


def test_motor_crosses_the_gap_before_the_hub_moves():
    gap, torque = 0.02, 0.1
    plant = PLANT.with_backlash(gap, MOTOR)
    contact = math.sqrt(gap * MOTOR / torque)  # gap / 2 = torque / (2 J) t^2
    time = np.array([0.0, 0.98 * contact, 1.1 * contact])
    phi = np.append(REST, 0.0)
    run = (np.zeros(1), np.full(1, torque), time, phi, 0 * phi, 1, False, CONTACT_STEP)
    angles, rates, _ = planar.simulate(plant, *run)
    assert rates[1, 0] == 0.0
    assert angles[1, -1] == pytest.approx(0.98**2 * gap / 2, rel=1e-6)
    assert rates[2, 0] > 0.1


@pytest.mark.parametrize("ratio", [CONTACT_DAMPING, 0.01, 0.8])
@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_motor_comes_back_from_a_flank_as_spring_and_damper_let_it(ratio, rate):
    plant = PLANT.with_backlash(0.01, MOTOR, 1000.0, ratio)
    phi, omega = np.append(REST, 0.0), np.append(REST, rate)
    # The free way to the flank, and out of the contact of some 1.6 ms.
    time = np.array([0.0, 0.005 / rate + 0.004])
    _, rates, _ = planar.simulate(plant, *NO_DRIVE, time, phi, omega, 0, True, 2e-6)
    # The flank is left where k d + c d' is zero, at the phase p of the decay d = exp(-z p/s) sin p, s^2 = 1 - z^2.
    s = math.sqrt(1 - ratio**2)
    p = math.pi - math.atan2(2 * ratio * s, 1 - 2 * ratio**2)
    back = math.exp(-ratio * p / s) * (math.cos(p) - ratio / s * math.sin(p))
    assert rates[-1, -1] == pytest.approx(rate * back, rel=1e-3)


def test_play_passes_on_what_the_hub_takes():
    plant = PLANT.with_backlash(0.02, MOTOR)
    period = 5e-4
    time = np.arange(0, 0.8, period)
    command = np.where(time < 0.4, 0.1, -0.1)
    phi = np.append(REST, 0.0)
    angles, rates, _ = planar.simulate(plant, time, command, time, phi, 0 * phi, 1, False, period)
    acceleration = np.gradient(rates[:, 0], period)
    held = np.append(command[0], (command[1:] + command[:-1]) / 2)
    passed = planar.backlash_torque(plant, period, acceleration, angles[:, 0], held)
    behind = plant.without_motor()
    hub = (angles[:, 0], rates[:, 0], acceleration, (acceleration[1:] + acceleration[:-1]) / 2)
    _, _, taken = planar.simulate_prescribed_hub(behind, time, *hub, REST, REST, 2.5e-4)
    missing = low_passed(taken - passed, period)
    # Without the play and its motor, what is missing is ten times as much.
    assert np.std(missing) < 0.1 * np.std(low_passed(taken - held, period))


@pytest.mark.parametrize(
    ("plant", "step", "tolerance"),
    # MuJoCo's steps do not end where an impact begins: its error falls with its step.
    [(torsional(), 1e-4, 1e-6), (PLANT.with_backlash(0.02, MOTOR), 5e-6, 1e-4)],
    ids=["torsional-mode", "backlash"],
)
def test_locked_hub_moves_alike_in_mujoco(plant, step, tolerance):
    phi = np.append(REST, 0.02)
    torques = (torque_of("cogging", amplitude=0.01, order=5.0),)
    lagging = changed(plant, motor={"lag": 0.005}, torques=torques)
    time = np.arange(0, 0.1, 2e-3)
    run = (np.array([0.0, 0.05]), np.array([0.1, -0.1]), time, phi, 0 * phi, 0, True)
    angles, _, _ = planar.simulate(lagging, *run, 1e-4)
    found, _, _ = MujocoChain(RIG, CHAIN, lagging, torques).simulate(*run, step)
    np.testing.assert_allclose(found, angles, atol=tolerance)


def sticking_motor():
    levels = {
        "static_positive": 0.04,
        "static_negative": 0.04,
        "coulomb_positive": 0.02,
        "coulomb_negative": 0.02,
    }
    return PLANT.with_friction(**levels).with_backlash(0.02, MOTOR, friction_on_motor=True)


def test_resting_motor_leaves_the_hub_free_within_the_play():
    plant = sticking_motor()
    time = np.arange(0, 2.0, 1e-3)
    phi, omega = np.append(REST, 0.0), np.append(0 * REST + 0.05, 0.0)
    angles, _, modes = planar.simulate(plant, *NO_DRIVE, time, phi, omega, 0, False, 1e-3)
    assert np.ptp(angles[:, -1]) == 0.0
    assert not modes.any()
    # Friction on the hub would have held it at once; the flanks yield by a little.
    assert 0.02 < np.ptp(angles[:, 0]) < 0.024


def test_motor_breaks_away_at_the_static_level_and_slides_at_the_coulomb_level():
    plant = sticking_motor()
    time = np.array([0.0, 0.4, 0.41])
    phi = np.append(REST, 0.0)
    command = np.array([0.0, 0.4]), np.array([0.0399, 0.0401])
    angles, rates, modes = planar.simulate(plant, *command, time, phi, 0 * phi, 0, False, 1e-3)
    assert angles[1, -1] == 0.0
    assert modes[2] == 1
    assert rates[2, -1] == pytest.approx(0.01 * (0.0401 - 0.02) / MOTOR, rel=1e-3)
    assert angles[2, 0] == 0.0


def test_motor_sticks_alike_in_mujoco():
    plant = sticking_motor()
    time = np.arange(0, 0.3, 5e-3)
    phi = np.append(REST, 0.0)
    run = (np.array([0.0, 0.06]), np.array([0.1, 0.0]), time, phi, 0 * phi, 1, False)
    angles, _, modes = planar.simulate(plant, *run, 1e-4)
    assert set(modes) > {0.0, 1.0}
    found, _, _ = MujocoChain(RIG, CHAIN, plant).simulate(*run, 5e-6)
    np.testing.assert_allclose(found, angles, atol=3e-4)


def test_impacts_do_not_depend_on_the_step():
    plant = PLANT.with_backlash(0.02, MOTOR)
    time = np.arange(0, 0.5, 5e-3)
    run = (np.zeros(1), np.full(1, 0.05), time, np.append(REST, 0.0), np.zeros(len(REST) + 1), 1, False)
    coarse, fine = (planar.simulate(plant.with_motor(contact_step=h), *run, h)[0] for h in (2e-4, 1e-5))
    np.testing.assert_allclose(coarse, fine, atol=1e-5)


@pytest.mark.parametrize(
    ("plant", "tolerance"),
    # MuJoCo's limits are softer at first than a spring.
    [(torsional(), 1e-5), (PLANT.with_backlash(0.02, MOTOR), 2e-3)],
    ids=["torsional-mode", "backlash"],
)
def test_file_moves_alike_in_plain_mujoco(plant, tolerance):
    model = mujoco.MjModel.from_xml_string(mjcf.build_spec(RIG, CHAIN, plant).to_xml())
    model.opt.timestep = 1e-4
    data = mujoco.MjData(model)
    data.actuator("motor").ctrl = 0.1
    mujoco.mj_step(model, data, 2000)
    phi = np.append(REST, 0.0)
    time = np.array([0.0, data.time])
    angles, _, _ = planar.simulate(plant, np.zeros(1), np.full(1, 0.1), time, phi, 0 * phi, 1, False, 1e-4)
    assert angles[-1, 0] > 0.1
    assert data.joint("hub").qpos[0] == pytest.approx(angles[-1, 0], abs=tolerance)
