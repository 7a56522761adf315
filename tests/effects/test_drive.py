"""The torque that a drive delivers: its impulse is its integral."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial.legendre import leggauss

from twin.effects import REGISTRY
from twin.effects.base import Drive
from twin.recording import Sensor

NODES, WEIGHTS = leggauss(20)
TORQUES = st.floats(-1.0, 1.0)


@st.composite
def drives(draw):
    """Drives of up to twelve commands, each held for 1 to 50 ms."""
    periods = np.array(draw(st.lists(st.floats(1e-3, 0.05), min_size=1, max_size=12)))
    torque = np.array(draw(st.lists(TORQUES, min_size=len(periods), max_size=len(periods))))
    first = draw(st.floats(-1.0, 1.0))
    # Down to a tenth of the longest period: twenty nodes integrate ten time constants to rounding.
    lag = draw(st.just(0.0) | st.floats(0.005, 0.5))
    return Drive(first + np.cumsum(periods) - periods[0], torque, draw(TORQUES), lag)


@given(drive=drives(), shares=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=8))
def test_the_impulse_is_the_integral_of_the_delivered_torque(drive, shares):
    start, end = drive.time[0] - 0.02, drive.time[-1] + 0.05
    instants = np.sort(start + np.array(shares) * (end - start))
    # Between these the torque is smooth.
    edges = np.sort(np.r_[instants, drive.time[(drive.time > instants[0]) & (drive.time < instants[-1])]])
    half = np.diff(edges)[:, None] / 2
    parts = (half * drive.at(edges[:-1, None] + half * (1 + NODES)) * WEIGHTS).sum(axis=1)
    integral = np.r_[0.0, np.cumsum(parts)][np.searchsorted(edges, instants)]
    impulse = drive.impulse(instants)
    np.testing.assert_allclose(impulse - impulse[0], integral, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("behind", "read"), [(0.0, 0.095), (1.0, 0.1)])
def test_a_sensor_of_current_does_not_see_the_gain_behind_it(behind, read):
    effect, values = REGISTRY["torque-gain"], {"gain": 0.95, "behind_sensor": behind}
    delivered = np.array([0.095])
    channels = effect.sensing(np.zeros(1), {"motor_torque": delivered}, values)
    assert channels["motor_torque"] == pytest.approx([read])


def test_what_is_declared_of_the_torque_sensor_decides():
    effect = REGISTRY["torque-gain"]
    for sees, possible in ((None, [True, True]), (True, [True, False]), (False, [False, True])):
        sensors = {"motor_torque": Sensor("motor_torque", sees_gain=sees)}
        assert [effect.fits(s, sensors) for s in effect.starts({})] == possible
