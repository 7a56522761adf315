"""The augmented rig as MJCF: every effect compiles, laws of the drive act, what is left out is told."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import synthetic_diagnosis as synthetic

from twin.augmented_mjcf import to_mjcf
from twin.diagnosis import AdoptedEffect
from twin.effects import REGISTRY
from twin.parameters import Rig


@pytest.fixture(scope="module")
def explained():
    return synthetic.diagnosis(duration=0.4)


def with_effect(diagnosis, name, **parameters):
    """Returns the diagnosis with this one effect; parameters left out are where a search would start."""
    values = {**REGISTRY[name].starts(diagnosis.fitted)[0], **parameters}
    return replace(diagnosis, effects=(AdoptedEffect(name, 0.9, values, {}, {}),))


def compiled(diagnosis):
    return mujoco.MjModel.from_xml_string(to_mjcf(diagnosis, synthetic.SENSORS).xml)


def delivered(diagnosis, command, steps=1):
    """Returns the torque [N m] of all actuators on the hub after some steps under a constant command."""
    model = compiled(diagnosis)
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("motor").id] = command
    for _ in range(steps):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return data.qfrc_actuator[model.joint("hub").dofadr[0]]


def test_spring_is_in_the_file(explained):
    model = compiled(explained)
    hub = model.joint("hub")
    assert hub.stiffness[0] == pytest.approx(synthetic.CABLE["stiffness"])
    assert model.qpos_spring[hub.qposadr[0]] == pytest.approx(synthetic.CABLE["rest_angle"])
    assert model.body("hub").inertia[2] == pytest.approx(explained.fitted["hub_inertia"], rel=1e-5)


def test_gauges_are_those_of_the_campaign(explained):
    sensors = {"strain_base": synthetic.SENSORS["strain_base"]}
    model = mujoco.MjModel.from_xml_string(to_mjcf(explained, sensors).xml)
    names = [model.sensor(i).name for i in range(model.nsensor)]
    assert "strain_base" in names
    assert "strain_mid" not in names


@pytest.mark.parametrize("name", REGISTRY)
def test_every_effect_compiles_and_moves(explained, name):
    model = compiled(with_effect(explained, name))
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("motor").id] = 0.1
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert data.warning.number.sum() == 0
    assert data.joint("hub").qpos[0] > 0


def test_gain_acts_behind_the_saturation(explained):
    weak = with_effect(explained, "torque-gain", gain=0.5)
    assert delivered(weak, 0.1) == pytest.approx(0.05)
    assert delivered(weak, 1.0) == pytest.approx(0.5 * explained.fitted["torque_limit"])


def test_bias_is_there_without_a_command(explained):
    assert delivered(with_effect(explained, "torque-bias", bias=0.003), 0.0) == pytest.approx(0.003)


def test_delay_holds_the_torque_back(explained):
    late = with_effect(explained, "actuator-delay", delay=0.01)
    step = compiled(late).opt.timestep
    assert delivered(late, 0.1, round(0.008 / step)) == pytest.approx(0.0)
    assert delivered(late, 0.1, round(0.012 / step)) == pytest.approx(0.1)


def test_what_is_left_out_is_told_in_the_file(explained):
    found = to_mjcf(with_effect(explained, "hub-sensor-gain", gain=1.02), synthetic.SENSORS)
    assert found.left_out == ("break-away friction above Coulomb", "hub-sensor-gain")
    assert "hub-sensor-gain" in found.xml.split("-->")[0]


def test_odd_names_end_no_comment_and_no_attribute(explained):
    name = 'a --> "rig" <b> & \n\x07 ü ---'
    odd = replace(explained, campaign=name, fitted=Rig(name, explained.fitted.parameters))
    xml = to_mjcf(odd, synthetic.SENSORS).xml
    assert ElementTree.fromstring(xml).tag == "mujoco"
    mujoco.MjModel.from_xml_string(xml)


def test_endless_torque_is_not_limited(explained):
    endless = replace(explained, fitted=explained.fitted.replace(torque_limit=np.inf))
    assert delivered(endless, 5.0) == pytest.approx(5.0)


def test_bridges_see_the_twist(explained):
    seen = {"strain_base": 4e-3, "strain_mid": -2e-3}
    found = to_mjcf(with_effect(explained, "torsional-mode", **seen), synthetic.SENSORS)
    model = mujoco.MjModel.from_xml_string(found.xml)
    data = mujoco.MjData(model)
    data.joint("torsion").qpos = 0.01
    mujoco.mj_forward(model, data)
    for channel, coefficient in seen.items():
        assert data.sensor(channel).data[0] == pytest.approx(0.01 * coefficient)
    assert "torsional-mode" not in found.left_out
