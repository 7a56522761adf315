"""The paper's switch of friction: the plant is its limit, as window and step become small."""

import numpy as np
import pytest
from scipy.linalg import expm

from twin.control.plants import make_model
from twin.control.plants.modal_rig import modal_rig
from twin.control.plants.paper import PaperPlant
from twin.rigs import preset

RIG = preset("bossi2009")
PERIOD, STEPS = 2e-3, 400  # s, and steps of the switch in each


def torque(time: float) -> float:
    """Breaks the hub away twice a second; in between the bent link pulls, against a strong motor and a weak one."""
    return 0.12 * np.sin(4 * np.pi * time)


def switched(window: float, duration: float) -> np.ndarray:
    """Hub angle (m) at the samples by the switch itself: its rate looked at in every step of 5 us."""
    rig = modal_rig(make_model(RIG), 1)
    n = len(rig.mass)
    A = np.zeros((2 * n + 1, 2 * n + 1))
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, : 2 * n] = np.linalg.solve(rig.mass, -np.hstack([rig.stiffness, rig.damping]))
    A[n : 2 * n, 2 * n] = np.linalg.solve(rig.mass, rig.hub)
    step = expm(A * PERIOD / STEPS)
    z, found = np.zeros(2 * n + 1), []
    for k in range(round(duration / PERIOD)):
        motor = torque(k * PERIOD)
        for _ in range(STEPS):
            rate = rig.hub @ z[n : 2 * n]
            held = motor if abs(motor) < RIG["static_friction"] else RIG["static_friction"] * np.sign(rate)
            z[2 * n] = motor - (held if abs(rate) < window else RIG["coulomb_friction"] * np.sign(rate))
            z = step @ z
        found.append(rig.hub @ z[:n])
    return np.array(found)


def moved(plant: PaperPlant, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Hub angle (m) and mode (m) at the samples."""
    plant.reset()
    angles, modes = [], []
    for k in range(round(duration / PERIOD)):
        plant.advance(torque(k * PERIOD))
        angles.append(plant.read()["hub_angle"])
        modes.append(plant.mode)
    return np.array(angles), np.array(modes)


def test_the_plant_is_the_limit_of_the_switch():
    duration = 0.5
    angles, modes = moved(PaperPlant(make_model(RIG), PERIOD), duration)
    assert {-1, 0, 1} == set(modes)
    # Within its window a hub creeps, at most as fast as the window is wide.
    wide, narrow = (np.abs(switched(window, duration) - angles).max() for window in (0.02, 0.002))
    assert narrow < 0.03 * np.ptp(angles)
    assert narrow < 0.4 * wide


def test_a_bent_link_turns_a_hub_that_the_motor_leaves():
    plant = PaperPlant(make_model(RIG), PERIOD)
    plant.reset()
    plant._z[1], plant._mode = 5e-4, 0  # bent, at rest
    before = plant.read()["hub_angle"]
    pull = abs(plant._holding_torque())
    assert RIG["coulomb_friction"] < pull < RIG["static_friction"]
    plant.advance(0.0)
    assert plant.mode != 0
    assert plant.read()["hub_angle"] != pytest.approx(before, abs=1e-6)


@pytest.mark.parametrize(("motor", "rests"), [(0.05, False), (0.08, True)])
def test_a_motor_above_the_static_level_is_held_together_with_the_link(motor, rests):
    plant = PaperPlant(make_model(RIG), PERIOD)
    plant.reset()
    plant._z[1], plant._mode = 1.7e-3, 0  # the link pulls back by more than the motor pushes
    plant._z[plant._command] = motor
    needed = plant._holding_torque()
    assert -RIG["static_friction"] < needed < -RIG["coulomb_friction"]
    plant.advance(motor)
    assert (plant.mode == 0) == rests
