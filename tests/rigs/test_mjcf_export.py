"""The augmented rig as MJCF: every effect compiles and does in plain MuJoCo what the twin says, or is left out."""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import synthetic_diagnosis as synthetic

from twin.diagnosis.answer import AdoptedEffect
from twin.effects import REGISTRY, Effect
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.parameters import Rig
from twin.recording import Recording
from twin.report.augmented_rig import to_mjcf
from twin.rigs.mjcf_sensors import SENSORS
from twin.rigs.model import Model
from twin.rigs.simulate import simulate


@pytest.fixture(scope="module")
def explained():
    return synthetic.diagnosis(duration=0.4)


def with_effect(diagnosis, name, **parameters):
    """Returns the diagnosis with this one effect; parameters left out are where a search would start."""
    values = {**REGISTRY[name].starts(diagnosis.fitted)[0], **parameters}
    return replace(diagnosis, effects=(AdoptedEffect(name, values, {}, {}, 0.9),))


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
    found = to_mjcf(with_effect(explained, "softening-stiffness"), synthetic.SENSORS)
    assert found.left_out == ("break-away friction above Coulomb", "softening stiffness")
    assert "softening stiffness" in found.xml.split("-->")[0]


def test_a_reading_that_cannot_be_written_is_told(explained, monkeypatch):
    misread = with_effect(explained, "hub-sensor-gain")
    assert "hub-sensor-gain" not in to_mjcf(misread, synthetic.SENSORS).left_out
    monkeypatch.setattr(type(REGISTRY["hub-sensor-gain"]), "reading", Effect.reading)
    assert "hub-sensor-gain" in to_mjcf(misread, synthetic.SENSORS).left_out


def test_strains_lag_behind_a_clamp_that_gives_and_it_is_told(explained):
    soft = to_mjcf(with_effect(explained, "root-compliance", stiffness=100.0), synthetic.SENSORS)
    assert "lag of strains behind a clamp that gives" in soft.left_out


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


# Readings in plain MuJoCo against those that the twin predicts

PERIOD = 0.002  # s, four steps
GAINS = {"gain_base": 0.9, "gain_mid": 1.1}
DRIFT = {"rate_base": 1e-3, "rate_mid": -2e-3}
WAVE = {"amplitude": 0.02, "order": 3.0, "phase": 0.4}
LATE = {"delay": 0.0073, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 1.0}
HUM = {"amplitude": 0.05, "phase": 0.7, "base": 0.0, "direction": 0.0}
LAG = {"actuator-lag": {"time_constant": 0.02}}
TWIST = {
    "frequency": 28.0,
    "damping_ratio": 0.02,
    "inertia_share": 0.2,
    "strain_base": 4e-3,
    "strain_mid": -2e-3,
}
ROUGH = {
    "static_positive": 0.008,
    "static_negative": 0.003,
    "coulomb_positive": 0.008,
    "coulomb_negative": 0.003,
}
# The effects, and how far off a reading may be, as a part of its largest value.
SAID = {
    "nothing": ({}, 2e-4),
    "hub gain": ({"hub-sensor-gain": {"gain": 1.05}}, 2e-4),
    "strain gain": ({"strain-gain": GAINS}, 2e-4),
    "drift": ({"strain-drift": DRIFT}, 2e-4),
    "wave": ({"hub-sensor-nonlinearity": WAVE}, 2e-4),
    "delay": ({"sensor-delay": LATE}, 2e-3),
    "delay of the hub": ({"sensor-delay": {**LATE, "strain": 0.0, "motor_torque": 0.0}}, 2e-3),
    "lag": (LAG, 2e-4),
    "short lag": ({"actuator-lag": {"time_constant": 3e-4}}, 3e-4),
    "air drag": ({"air-drag": {"coefficient": 0.1}}, 2e-4),
    "slow hum": ({"periodic-disturbance": {**HUM, "frequency": 0.5}}, 2e-4),
    "fast hum": ({"periodic-disturbance": {**HUM, "frequency": 58.0}}, 5e-4),
    "wave, then gain": ({"hub-sensor-nonlinearity": WAVE, "hub-sensor-gain": {"gain": 1.5}}, 2e-4),
    "gain, then wave": ({"hub-sensor-gain": {"gain": 1.5}, "hub-sensor-nonlinearity": WAVE}, 2e-4),
    "gain and delay": ({"hub-sensor-gain": {"gain": 1.5}, "sensor-delay": LATE}, 2e-3),
    "gain, delay, drift": ({"strain-gain": GAINS, "sensor-delay": LATE, "strain-drift": DRIFT}, 2e-3),
    "drift, gain, delay": ({"strain-drift": DRIFT, "strain-gain": GAINS, "sensor-delay": LATE}, 2e-3),
    "twist and gain": ({"torsional-mode": TWIST, "strain-gain": GAINS}, 2e-4),
    "gain, bias, lag": ({"torque-gain": {"gain": 0.8}, "torque-bias": {"bias": 0.01}, **LAG}, 2e-4),
    "dead time and lag": ({"actuator-delay": {"delay": 0.0123}, **LAG}, 2e-2),
    "two drags": ({"air-drag": {"coefficient": 0.1}, "air-pad-drag": {"viscous": 0.1}}, 2e-4),
}


def slewed(rig, duration=1.0):
    """Returns an experiment whose command is beyond the saturation, to and fro, then nothing."""
    time = np.arange(round(duration / PERIOD)) * PERIOD
    command = 1.3 * rig["torque_limit"] * np.sign(np.sin(10 * time + 0.3)) * (time < 0.8 * duration)
    readings = {channel: np.zeros(len(time)) for channel in SENSORS if channel != "tip_acceleration"}
    return Recording("slewed", time, {"torque_command": command, **readings})


def predicted(rig, effects, recording):
    """Returns what the twin says that the sensors report."""
    model = Model(rig, synthetic.SENSORS, chain.fit_shape(rig), effects)
    return simulate(model, recording, Start())


def written(diagnosis, rig, effects, recording):
    """Returns what the sensors of the written file report: channel -> (n)."""
    adopted = tuple(AdoptedEffect(name, p, {}, {}, 0.9) for name, p in effects.items())
    found = to_mjcf(replace(diagnosis, fitted=rig, effects=adopted), synthetic.SENSORS)
    assert found.left_out == ()
    model = mujoco.MjModel.from_xml_string(found.xml)
    data, motor = mujoco.MjData(model), model.actuator("motor").id
    steps = round(PERIOD / model.opt.timestep)
    read = {channel: [] for channel in recording.measured()}
    for command in recording["torque_command"]:
        data.ctrl[motor] = command
        mujoco.mj_step(model, data)  # reads the sensors before it moves on
        for channel, values in read.items():
            reading = data.sensor(SENSORS[channel]).data
            values.append(reading[1] if channel == "tip_deflection" else reading[0])
        mujoco.mj_step(model, data, steps - 1)
    return {channel: np.array(values) for channel, values in read.items()}


@pytest.mark.parametrize("case", SAID)
def test_plain_mujoco_reads_what_the_twin_predicts(explained, case):
    effects, tolerance = SAID[case]
    rig = explained.fitted.replace(static_friction=0.0, coulomb_friction=0.0)
    recording = slewed(rig)
    wanted, read = predicted(rig, effects, recording), written(explained, rig, effects, recording)
    known = recording.time > LATE["delay"] + PERIOD if "sensor-delay" in effects else recording.time >= 0
    for channel, values in read.items():
        off = np.abs(values - wanted[channel])[known].max()
        assert off < tolerance * np.abs(wanted[channel]).max(), channel
    for name in effects:  # without any one of them the readings are others
        rest = predicted(rig, {other: p for other, p in effects.items() if other != name}, recording)
        shares = [np.abs(rest[c] - wanted[c])[known].max() / np.abs(wanted[c]).max() for c in read]
        assert max(shares) > 5 * tolerance, name


def test_friction_has_the_level_of_each_direction(explained):
    rough = with_effect(explained, "asymmetric-friction", **ROUGH)
    found = to_mjcf(rough, synthetic.SENSORS)
    assert found.left_out == ()
    model = mujoco.MjModel.from_xml_string(found.xml)
    data = mujoco.MjData(model)
    for rate, level in ((2.0, -ROUGH["coulomb_positive"]), (-2.0, ROUGH["coulomb_negative"])):
        data.joint("hub").qvel = rate
        mujoco.mj_forward(model, data)
        hub = model.joint("hub").dofadr[0]
        assert data.qfrc_constraint[hub] + data.qfrc_actuator[hub] == pytest.approx(level)


def test_bias_is_in_the_reading_of_the_torque(explained):
    model = compiled(with_effect(explained, "torque-bias", bias=0.003))
    data = mujoco.MjData(model)
    data.ctrl[model.actuator("motor").id] = 10.0
    mujoco.mj_forward(model, data)
    assert data.sensor("motor_torque").data[0] == pytest.approx(explained.fitted["torque_limit"] + 0.003)


def test_reading_a_sum_moves_nothing(explained):
    effects = {"strain-drift": DRIFT, "hub-sensor-nonlinearity": WAVE}
    rig = explained.fitted.replace(static_friction=0.0, coulomb_friction=0.0)
    recording = slewed(rig)
    truth, read = (written(explained, rig, some, recording) for some in ({}, effects))
    assert read["tip_deflection"] == pytest.approx(truth["tip_deflection"], abs=1e-8)
