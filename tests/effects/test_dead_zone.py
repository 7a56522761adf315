"""The dead zone of a drive."""

import numpy as np

from twin.effects import REGISTRY, Drive


def test_a_dead_zone_takes_its_half_width_from_every_larger_command():
    drive = Drive(np.arange(5.0), np.array([-0.3, -0.05, 0.0, 0.1, 0.4]), before=-0.2)
    delivered = REGISTRY["dead-zone"].drive(drive, {"half_width": 0.1})
    np.testing.assert_allclose(delivered.torque, [-0.2, 0.0, 0.0, 0.0, 0.3], atol=1e-15)
    assert delivered.before == -0.1
