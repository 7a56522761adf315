"""Experiments that tell two explanations apart: which, by how much, and as a file that a card can play."""

import csv
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from twin import chain, planning
from twin.errors import InputError
from twin.model import Model
from twin.planner import Planned, to_json, write_torque
from twin.planner import plan as plan_for
from twin.recording import Sensor
from twin.rigs import preset

RIG = preset("bossi2009")
SENSORS = {name: Sensor(name, 2e-6, x, 0.001) for name, x in (("strain_base", 0.02), ("strain_mid", 0.21))}
NOISE = {"hub_angle": 3e-4, "strain_base": 2e-6, "strain_mid": 2e-6}
MODEL = Model(RIG, SENSORS, chain.fit_shape(RIG, 4), step=2e-3)


def planned(first, second, names=None):
    options = [e for e in planning.experiments(RIG) if names is None or e.name in names]
    with ThreadPoolExecutor(2) as pool:
        return planning.plan(
            MODEL.replace(effects=first), MODEL.replace(effects=second), NOISE, pool, options
        )


def test_nothing_separates_a_model_from_itself():
    plans = planned({}, {}, ["slews", "ramp", "large-decay"])
    assert [p.separation for p in plans] == [0.0, 0.0, 0.0]
    assert "No experiment" in planning.said(plans, ("one", "other"))


def test_what_acts_on_the_link_alone_is_seen_with_the_hub_locked():
    softer = {"softening-stiffness": {"softening": 0.3, "curvature": 0.8}}
    best, *_ = planned(softer, {"viscous-friction": {"viscous": 1e-3}}, ["small-decay", "large-decay"])
    assert best.experiment.name == "large-decay"
    assert best.channel in ("strain_base", "strain_mid")


def test_a_payload_added_separates_what_one_payload_does_not():
    """A heavier payload and a stiffer, heavier everything turn alike under one payload, not under two."""
    heavy = {"payload-mass": {"tip_mass": 0.17}}
    plans = {p.experiment.name: p for p in planned(heavy, {}, ["slews", "slews-payload"])}
    loaded = planning._loaded(MODEL.replace(effects=heavy), 0.05)
    assert loaded.rig["tip_mass"] == pytest.approx(0.22)
    assert plans["slews-payload"].separation > 3


def test_every_experiment_is_within_the_amplifier_and_ends_in_a_rest_or_a_sweep():
    for experiment in planning.experiments(RIG):
        torque = experiment.recording["torque_command"]
        assert np.abs(torque).max() <= RIG["torque_limit"]
        assert len(torque) == pytest.approx(experiment.recording.duration / 2e-3, abs=2)


def test_declared_rig_can_do_every_experiment():
    with ThreadPoolExecutor(2) as pool:
        plans = planning.plan(MODEL, MODEL, NOISE, pool)
    assert len(plans) == len(planning.experiments(RIG))


def test_hub_is_never_turned_further_than_its_wires_allow():
    turning = {"torque-bias": {"bias": 0.15}}
    assert not planned(turning, {}, ["slews"])


def test_torque_file_is_what_was_simulated(tmp_path):
    plans = planned({"cable-torsion": {"stiffness": 0.01, "rest_angle": 0.0}}, {}, ["slews"])
    assert write_torque(plans, tmp_path / "torque.csv") is plans[0]
    with (tmp_path / "torque.csv").open() as file:
        rows = list(csv.DictReader(file))
    torque = np.array([float(r["torque_command"]) for r in rows])
    np.testing.assert_allclose(torque, plans[0].experiment.recording["torque_command"], rtol=1e-5)
    assert to_json(Planned(("a", "b"), plans, 50.0))["experiments"][0]["name"] == "slews"


def test_a_decay_that_is_let_go_by_hand_has_no_torque_to_write(tmp_path):
    softer = {"softening-stiffness": {"softening": 0.3, "curvature": 0.8}}
    decay, slews = planned(softer, {}, ["large-decay"]), planned(softer, {}, ["slews"])
    assert write_torque([*decay, *slews], tmp_path / "torque.csv") is slews[0]
    with pytest.raises(InputError, match="no torque makes"):
        write_torque(decay, tmp_path / "none.csv")
    assert not (tmp_path / "none.csv").exists()


def test_names_that_are_no_effects_are_refused():
    with pytest.raises(InputError, match="did you mean 'cable-torsion'"):
        plan_for(None, ("cable-torsoin", "gravity-tilt"))
    with pytest.raises(InputError, match="given twice"):
        plan_for(None, ("gravity-tilt", "gravity-tilt"))


@pytest.mark.parametrize(("score", "speaks"), [(12.3, False), (812.4, True)])
def test_a_plan_says_whether_the_recordings_speak_for_either_effect(score, speaks):
    plans = planned({"air-drag": {"coefficient": 0.1}}, {"air-pad-drag": {"viscous": 0.02}}, ["slews"])
    said = Planned(("air-drag", "air-pad-drag"), plans, score).said()
    assert "record slews" in said
    assert ("speak for neither air-drag nor air-pad-drag" in said) != speaks
