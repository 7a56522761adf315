"""Gain and delay of channels in a model: what it reads, and what the readings say of the hub."""

import numpy as np
import pytest

from twin.effects import REGISTRY
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.rigs import preset
from twin.rigs.channel_errors import ChannelErrors, replaced_errors, with_replaced_errors
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

TIME = 0.002 * np.arange(600)
TORQUE = np.where((TIME > 0.1) & (TIME < 0.9), 0.1 * np.sin(2 * np.pi * (TIME - 0.1) / 0.8), 0.0)
CHANNELS = ("hub_angle", "hub_rate", "strain_base", "motor_torque")
SENSORS = {"strain_base": GAUGES[0], "motor_torque": Sensor("motor_torque", sees_gain=False)}
RIG = preset("bossi2009")
MODEL = Model(RIG, SENSORS, chain.fit_shape(RIG, 4))


def readings(errors):
    blank = {"torque_command": TORQUE, **{c: np.zeros_like(TIME) for c in CHANNELS}}
    return simulate(MODEL.replace(channel_errors=errors), Recording("a", TIME, blank), Start())


@pytest.fixture(scope="module")
def true():
    return readings(ChannelErrors())


def test_the_rate_of_the_hub_is_the_slope_of_its_angle(true):
    slope = np.gradient(true["hub_angle"], TIME)
    moving = np.abs(true["hub_rate"]) > 0.1 * np.abs(true["hub_rate"]).max()
    assert moving.sum() > 100
    # A central difference is off by the change of the rate within a sample at a kink.
    np.testing.assert_allclose(true["hub_rate"][moving], slope[moving], atol=0.02 * np.abs(slope).max())


@pytest.mark.parametrize("channel", ["hub_angle", "hub_rate", "strain_base"])
def test_a_channel_reads_its_gain_times_what_was_there_a_delay_ago(true, channel):
    errors = ChannelErrors({channel: 1.05}, {channel: 0.004})
    read = readings(errors)
    np.testing.assert_allclose(read[channel][2:], 1.05 * true[channel][:-2], atol=1e-12)
    others = [c for c in CHANNELS if c != channel]
    assert all(np.array_equal(read[c], true[c]) for c in others)


def test_a_delay_of_a_torque_moves_it_by_parts_of_a_sample():
    step = np.where(TIME >= 0.1, 1.0, 0.0)
    read = ChannelErrors(delays={"motor_torque": 0.001}).read(TIME, {"motor_torque": step})["motor_torque"]
    assert read[np.searchsorted(TIME, 0.1 - 1e-9)] == pytest.approx(0.5)


def test_the_motion_of_the_hub_follows_from_its_readings():
    smooth = np.sin(3 * TIME)
    model = MODEL.replace(channel_errors=ChannelErrors({"hub_angle": 1.1}, {"hub_angle": 0.005}))
    read = model.report(TIME, {"hub_angle": smooth})["hub_angle"]
    inner = slice(10, -10)
    np.testing.assert_allclose(model.hub_angle_of(read, TIME)[inner], smooth[inner], atol=1e-9)
    assert model.hub_late == pytest.approx(0.005)


def test_the_gain_of_the_command_is_that_of_the_drive(true):
    model = MODEL.replace(channel_errors=ChannelErrors({"torque_command": 1.2}, {"torque_command": 0.004}))
    assert model.torque_gain == pytest.approx(1.2)
    run = Recording("a", TIME, {"torque_command": TORQUE})
    np.testing.assert_allclose(model.drive(run).at(TIME)[2:], 1.2 * TORQUE[:-2])
    # A sensor of the current stands before the gain.
    np.testing.assert_allclose(model.read_torque(run)[2:], TORQUE[:-2])
    seeing = model.replace(sensors={"motor_torque": Sensor("motor_torque", sees_gain=True)})
    np.testing.assert_allclose(seeing.read_torque(run)[2:], 1.2 * TORQUE[:-2])


def test_every_error_that_an_effect_is_does_the_same_as_the_effect():
    for name, effect in REGISTRY.items():
        for parameter, errors in effect.channel_errors.items():
            for kind, channel in errors:
                assert parameter in {p.name for p in effect.parameters}
                value = 1.01 if kind == "gain" else 0.002
                values = {**dict.fromkeys((p.name for p in effect.parameters), 1.0), parameter: value}
                assert (kind, channel) in effect.replaced_errors(values), name


def test_a_delay_replaces_those_of_the_channels_that_it_delays():
    late = {"delay": 0.003, "hub_angle": 1.0, "strain": 0.0, "motor_torque": 0.0}
    assert replaced_errors({"sensor-delay": late}) == {("delay", "hub_angle")}


def test_an_effect_takes_over_what_the_errors_did_that_it_replaces():
    errors = ChannelErrors({"strain_base": 1.03, "hub_angle": 0.98}, {"hub_angle": 0.002})
    gains = with_replaced_errors("strain-gain", {"gain_base": 1.1, "gain_mid": 0.9}, errors)
    assert gains == {"gain_base": pytest.approx(1.133), "gain_mid": 0.9}
    late = {"delay": 0.003, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}
    assert with_replaced_errors("sensor-delay", late, errors)["delay"] == pytest.approx(0.005)
    left = errors.without(replaced_errors({"strain-gain": gains}))
    assert (dict(left.gains), dict(left.delays)) == ({"hub_angle": 0.98}, {"hub_angle": 0.002})
