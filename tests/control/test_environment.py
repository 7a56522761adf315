"""The rig as a dm_env environment: dm_control's own conformance tests, over both plants."""

import math

import numpy as np
import pytest
from absl.testing import absltest
from dm_env import test_utils

from twin.control import plants
from twin.control.environment import FollowReference, make_environment, rig_environment
from twin.control.plants.sensors import BOSSI2009, Sensors
from twin.errors import InputError


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 0.0}, "duration is 0 s; expected 0.002 to"),
        ({"duration": -1.0}, "duration is -1 s"),
        ({"duration": math.nan}, "duration is nan"),
        ({"period": 0.0}, "period is 0 s; expected 1e-05 to 0.1 s"),
        ({"period": -1.0}, "period is -1 s"),
        ({"period": 1e-300}, "period is 1e-300 s"),
        ({"period": 1e9}, "period is 1e\\+09 s"),
        ({"reference": 5}, "reference is 5; expected a function of the time"),
    ],
)
def test_options_that_cannot_be_are_named(options, message):
    with pytest.raises(InputError, match=message):
        rig_environment(**options)


@pytest.mark.parametrize(
    ("angle", "found"), [(math.nan, "nan"), (1e300, "1e\\+300 rad"), ("a", "'a'"), (None, "missing")]
)
def test_a_reference_that_is_no_angle_is_named(angle, found):
    environment = rig_environment(reference=lambda time: angle)
    with pytest.raises(InputError, match=f"the reference at 0 s is {found}; expected"):
        environment.reset()


def test_a_torque_that_is_not_finite_is_named():
    environment = rig_environment()
    environment.reset()
    with pytest.raises(InputError, match="the torque is nan"):
        environment.step(math.nan)
