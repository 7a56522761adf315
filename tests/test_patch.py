"""A correction without a cause: recovered from what is left, and looked up in a simulation."""

import numpy as np
import pytest

from twin import chain
from twin.model import Model, Start, simulate
from twin.patch import HUB, Patch, smooth
from twin.recording import Recording, Sensor
from twin.rigs import preset

RIG = preset("bossi2009")
SENSORS = {"strain_base": Sensor("strain_base", 2e-6, 0.02, 0.001)}
MODEL = Model(RIG, SENSORS, chain.fit_shape(RIG, 4), step=1e-3)


def slew(torque=0.15) -> Recording:
    time = np.arange(0, 1.5, 2e-3)
    command = np.where(time < 0.3, torque, np.where(time < 0.6, -torque, 0.0))
    blank = np.zeros_like(time)
    return Recording("slew", time, {"torque_command": command, "hub_angle": blank, "strain_base": blank})


def lookup(channel, variable, x, y) -> Patch:
    return Patch(channel, variable, np.array(x, float), np.array(y, float), np.ones(len(x)))


def test_a_smooth_function_is_recovered_within_its_scatter():
    random = np.random.default_rng(5)
    angle = random.uniform(-1, 1, 6000)
    left = 0.01 * np.sin(3 * angle) + 0.004 * random.standard_normal(6000)
    found = smooth(left, angle, random.integers(0, 4, 6000), HUB, "hub_angle")
    assert found.x[0] == pytest.approx(-1, abs=0.1)
    assert np.abs(found.y - 0.01 * np.sin(3 * found.x)).max() < 1.5e-3
    assert found.count.sum() == pytest.approx(6000, rel=0.05)


def test_what_one_recording_alone_saw_is_no_support():
    random = np.random.default_rng(6)
    angle = random.uniform(0, 2, 4000)
    recording = np.where(angle > 1.2, 0, random.integers(0, 3, 4000))
    found = smooth(0.01 * angle, angle, recording, HUB, "hub_angle")
    assert found.x[-1] < 1.25
    assert smooth(angle[:50], angle[:50], recording[:50], HUB, "hub_angle") is None


def test_a_looked_up_spring_moves_as_the_effect_that_it_is():
    """A straight line in the hub's angle is a cable: the patch must move the hub as that effect does."""
    cable = MODEL.replace(effects={"cable-torsion": {"stiffness": 0.02, "rest_angle": 0.1}})
    patched = MODEL.replace(patch=lookup(HUB, "hub_angle", [-9, 9], [0.02 * 9.1, -0.02 * 8.9]))
    one, other = (simulate(m, slew(), Start())["hub_angle"] for m in (cable, patched))
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert np.abs(one - simulate(MODEL, slew(), Start())["hub_angle"]).max() > 0.01


def test_looked_up_by_rate_and_time_it_is_friction_and_a_bias():
    viscous = MODEL.replace(effects={"viscous-friction": {"viscous": 0.004}})
    by_rate = MODEL.replace(patch=lookup(HUB, "hub_rate", [-50, 50], [0.2, -0.2]))
    biased = MODEL.replace(effects={"torque-bias": {"bias": 0.01}})
    by_time = MODEL.replace(patch=lookup(HUB, "time", [0, 9], [0.01, 0.01]))
    for one, other in ((viscous, by_rate), (biased, by_time)):
        angles = [simulate(m, slew(), Start())["hub_angle"] for m in (one, other)]
        np.testing.assert_allclose(*angles, atol=1e-9)


def test_looked_up_by_the_command_it_is_a_gain():
    weak = MODEL.replace(effects={"torque-gain": {"gain": 0.9}})
    patched = MODEL.replace(patch=lookup(HUB, "torque_command", [-1, 1], [0.1, -0.1]))
    angles = [simulate(m, slew(), Start())["hub_angle"] for m in (weak, patched)]
    np.testing.assert_allclose(*angles, atol=1e-9)


def test_a_reading_is_changed_by_its_own_value():
    clipped = MODEL.replace(patch=lookup("strain_base", "strain_base", [-1, 0, 1], [1, 0, -1]))
    plain, bent = (simulate(m, slew(), Start()) for m in (MODEL, clipped))
    np.testing.assert_allclose(bent["strain_base"], 0.0, atol=1e-12)
    np.testing.assert_array_equal(plain["hub_angle"], bent["hub_angle"])


def test_beyond_its_support_it_stays_what_it_was_last():
    patch = lookup(HUB, "hub_angle", [0, 1], [0, 5])
    assert patch.at(np.array([-3.0, 0.5, 7.0])).tolist() == [0.0, 2.5, 5.0]
