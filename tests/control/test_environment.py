"""The rig as a dm_env environment: dm_control's own conformance tests, over both plants."""

import math

import numpy as np
import pytest
from absl.testing import absltest
from dm_env import test_utils

from twin.control import plants
from twin.control.environment import FollowReference, make_environment, rig_environment
from twin.control.plants.sensors import BOSSI2009, Sensors


class ChainConformance(test_utils.EnvironmentTestMixin, absltest.TestCase):
    def make_object_under_test(self):
        return rig_environment(duration=0.1, sensors=Sensors(BOSSI2009, seed=1))

    def make_action_sequence(self):
        return [np.asarray(u) for u in np.linspace(-0.2, 0.2, 80)]


class ModalConformance(ChainConformance):
    def make_object_under_test(self):
        return make_environment(plants.make_plant("modal"), FollowReference(lambda time: 0.5 * time), 0.1)


@pytest.mark.parametrize("duration", [0.1, 5.0, 0.006])
def test_an_episode_lasts_as_long_as_asked(duration):
    environment = rig_environment(duration=duration)
    step = environment.reset()
    while not step.last():
        step = environment.step(0.0)
    assert float(step.observation["time"]) == pytest.approx(duration, abs=1e-9)


def test_reward_is_full_on_the_reference_and_falls_off():
    environment = rig_environment(reference=lambda time: 0.0)
    environment.reset()
    assert environment.step(0.0).reward == 1.0
    far = rig_environment(reference=lambda time: math.radians(30.5))
    far.reset()
    assert far.step(0.0).reward == pytest.approx(0.1)


def test_noise_is_repeated_by_its_seed_and_reset():
    environment = rig_environment(sensors=Sensors(BOSSI2009, seed=3))
    first = environment.reset().observation
    environment.step(0.1)
    again = environment.reset().observation
    other = rig_environment(sensors=Sensors(BOSSI2009, seed=4)).reset().observation
    assert first["hub_angle"] == again["hub_angle"] != other["hub_angle"]
    assert first["hub_angle"] / (2 * math.pi / 2**16) == pytest.approx(
        round(first["hub_angle"] * 2**15 / math.pi)
    )
