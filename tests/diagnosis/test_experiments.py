"""Experiments that tell two explanations apart: which, by how much, and as a file that a card can play."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from homogeneous import HOMOGENEOUS
from marks import slow_except

from twin.diagnosis import experiments, separation
from twin.diagnosis.plan import ExperimentPlan, to_json, write_torque
from twin.diagnosis.plan import plan as plan_for
from twin.diagnosis.separation import Explanation
from twin.errors import InputError
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import Unknown, declared_unknowns
from twin.mechanics import chain
from twin.recording import Sensor
from twin.rigs import preset
from twin.rigs.model import Model

RIG = preset("bossi2009")
SENSORS = {name: Sensor(name, 2e-6, x, 0.001) for name, x in (("strain_base", 0.02), ("strain_mid", 0.21))}
NOISE = {"hub_angle": 3e-4, "strain_base": 2e-6, "strain_mid": 2e-6}
MODEL = Model(RIG, SENSORS, chain.fit_shape(RIG, 4), step=2e-3)


def planned(first, second, names=None):
    """Plans of two effects, nothing to be fitted again."""
    return ranked(*(Explanation(MODEL.replace(effects=effects)) for effects in (first, second)), names)


def ranked(first, second, names=None):
    options = [e for e in experiments.possible_experiments(RIG) if names is None or e.name in names]
    with ResidualPool(1) as pool:
        return experiments.rank(first, second, NOISE, pool, options)


def within(model, unknowns, share):
    """The model, its unknowns at what it has, each by itself known to a share of its scale."""
    rig, effects = model.declared, model.effects
    values = [rig[u.name] if u.kind == "rig" else effects[u.effect][u.name] for u in unknowns]
    errors = np.array([share * u.scale for u in unknowns])
    return Explanation.of(model, unknowns, np.array(values), np.diag(errors**2))


def declared_within(effects, share):
    model = MODEL.replace(effects=effects)
    return within(model, declared_unknowns(model), share)


def test_nothing_separates_a_model_from_itself():
    plans = planned({}, {}, ["slews", "ramp", "large-decay"])
    assert [p.separation for p in plans] == [0.0, 0.0, 0.0]
    assert "No experiment" in experiments.recommendation(plans, ("one", "other"))


def test_a_recommendation_says_what_to_do_before_the_name_of_the_experiment():
    far = SimpleNamespace(name="far-slew", how="a long bang-bang slew, and back")
    plan = SimpleNamespace(experiment=far, separation=12.8, channel="hub_angle", sensor=None)
    said = experiments.recommendation([plan], ("one", "other"))
    assert "record a long bang-bang slew, and back (far-slew): hub_angle differs by 12.8" in said


def test_what_acts_on_the_link_alone_is_seen_with_the_hub_locked():
    softer = {"softening-stiffness": {"softening": 0.3, "curvature": 0.8}}
    best, *_ = planned(softer, {"viscous-friction": {"viscous": 1e-3}}, ["small-decay", "large-decay"])
    assert best.experiment.name == "large-decay"
    assert best.channel in ("strain_base", "strain_mid")


@pytest.mark.parametrize("factor", slow_except([0.99, 1.005, 1.01], 1.005))
def test_what_the_stiffness_does_within_its_error_separates_nothing(factor):
    """Slews of other stiffness stick elsewhere: no slope says that, but a standard error leaves it open."""
    stiffness = [u for u in declared_unknowns(MODEL) if u.name == "bending_stiffness"]
    other = MODEL.replace(declared=RIG.replace(bending_stiffness=factor * RIG["bending_stiffness"]))
    names = ["slews", "far-slew", "large-decay", "slews-payload"]
    assert stiffness[0].scale == pytest.approx(0.02 * RIG["bending_stiffness"])
    assert ranked(Explanation(MODEL), Explanation(other), names)[0].separation > 100
    assert ranked(Explanation(MODEL), within(other, stiffness, 1.0), names)[0].separation < 2
    both = (within(model, stiffness, 1.0) for model in (MODEL, other))
    assert ranked(*both, names)[0].separation < 1


def test_what_an_effect_does_within_its_error_separates_nothing():
    def cable(stiffness):
        return MODEL.replace(effects={"cable-torsion": {"stiffness": stiffness, "rest_angle": 0.0}})

    unknown = Unknown("effect", "stiffness", 0.01, 2e-4, False, (0.0, 1.0), effect="cable-torsion")
    known = ranked(Explanation(cable(0.01)), Explanation(cable(0.0102)), ["slews", "far-slew"])
    fitted = ranked(Explanation(cable(0.01)), within(cable(0.0102), [unknown], 1.0), ["slews", "far-slew"])
    assert known[0].separation > 3
    assert fitted[0].separation < 0.2 * known[0].separation


def test_effects_that_differ_in_kind_stay_apart_whatever_the_rig_does_within_its_errors():
    softer = {"softening-stiffness": {"softening": 0.3, "curvature": 0.8}}
    explanations = (declared_within(e, 0.1) for e in (softer, {"viscous-friction": {"viscous": 1e-3}}))
    plans = {p.experiment.name: p for p in ranked(*explanations, ["large-decay", "small-decay"])}
    assert plans["large-decay"].separation > 10
    assert plans["small-decay"].separation < 1


def gain_or_scale(error):
    """A drive that gives 2 % more, and a rig whose forces and inertias are off by a common factor, to `error`."""
    unknowns = [u for u in declared_unknowns(MODEL) if u.name in HOMOGENEOUS]
    values = np.array([u.start for u in unknowns])
    scale = Explanation.of(MODEL, unknowns, values, error**2 * np.outer(values, values))
    return Explanation(MODEL.replace(effects={"torque-gain": {"gain": 1.02}})), scale


def test_a_payload_added_separates_what_one_payload_does_not():
    """A strong drive moves a rig as if all its forces and inertias were less; an added mass is not less."""
    plans = {p.experiment.name: p for p in ranked(*gain_or_scale(0.005), ["slews", "slews-payload"])}
    assert plans["slews"].separation < 1
    assert plans["slews-payload"].separation > 3 * plans["slews"].separation


def test_a_torque_sensor_separates_a_drive_from_what_it_moves():
    [slews] = ranked(*gain_or_scale(0.01), ["slews"])
    channel, separation = slews.sensor
    assert channel == "motor_torque"
    assert separation > 2 > 2 * slews.separation


def test_payload_is_added_to_that_of_an_effect():
    heavy = MODEL.replace(effects={"payload-mass": {"tip_mass": 0.17}})
    assert separation.with_added_mass(heavy, 0.05).rig["tip_mass"] == pytest.approx(0.22)


def test_moves_are_those_of_the_covariance_of_a_fit_without_clock_and_starts():
    unknowns = (
        *declared_unknowns(MODEL)[:3],
        Unknown("clock", "late", 0.0, 1e-4, True, (-1e-3, 1e-3)),
    )
    root = np.tril(np.random.default_rng(1).normal(size=(4, 4)))
    covariance = root @ root.T * np.outer(*2 * [[1e-3 * u.scale for u in unknowns]])
    values, nothing = np.array([u.start for u in unknowns]), np.zeros(0)
    fitted = Fit(MODEL, (), unknowns, values, covariance, nothing, nothing, 0.0, np.zeros((0, 4)))
    explanation = Explanation.of_fit(fitted, 1e-3)
    assert explanation.unknowns == unknowns[:3]
    np.testing.assert_allclose(explanation.axes.T @ explanation.axes, covariance[:3, :3], rtol=1e-6)


def test_moves_stay_within_bounds():
    stiffness = declared_unknowns(MODEL)[:1]
    explanation = within(MODEL, stiffness, 1.0)
    moved = explanation.moved(10 * explanation.axes[0])
    assert moved.declared["bending_stiffness"] in stiffness[0].bounds


def test_every_experiment_is_within_the_amplifier_and_ends_in_a_rest_or_a_sweep():
    for experiment in experiments.possible_experiments(RIG):
        torque = experiment.recording["torque_command"]
        assert np.abs(torque).max() <= RIG["torque_limit"]
        assert len(torque) == pytest.approx(experiment.recording.duration / 2e-3, abs=2)


def test_a_rig_without_payload_is_asked_for_none():
    bare = RIG.replace("bare", tip_mass=0.0, tip_inertia=0.0)
    assert {e.name for e in experiments.possible_experiments(RIG)} - {
        e.name for e in experiments.possible_experiments(bare)
    } == {"slews-payload"}


def test_a_plan_is_shown_in_words():
    experiment = experiments.possible_experiments(RIG)[0]
    plans = [experiments.Plan(experiment, 12.83, "strain_base", ("tip_acceleration", 62.4))]
    [(_, _, apart, channel, sensor)] = experiments.rows(plans)
    assert (apart, channel, sensor) == ("12.8", "base strain", "tip acceleration: 62.4")


def test_declared_rig_can_do_every_experiment():
    with ResidualPool(1) as pool:
        plans = experiments.rank(Explanation(MODEL), Explanation(MODEL), NOISE, pool)
    assert len(plans) == len(experiments.possible_experiments(RIG))


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
    assert to_json(ExperimentPlan(("a", "b"), plans, 50.0))["experiments"][0]["name"] == "slews"


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
    said = ExperimentPlan(("air-drag", "air-pad-drag"), plans, score).recommendation()
    assert "record strong bang-bang slews of two lengths, there and back (slews)" in said
    assert ("support neither air-drag nor air-pad-drag" in said) != speaks


def test_a_strong_motor_is_used():
    strong = RIG.replace(torque_limit=5.0, static_friction=0.5)
    slews = next(e for e in experiments.possible_experiments(strong) if e.name == "slews")
    assert np.abs(slews.recording["torque_command"]).max() == pytest.approx(0.93 * 5.0, rel=0.01)
    unlimited = {**{k: RIG[k] for k in RIG}, "torque_limit": np.inf}
    slews = next(e for e in experiments.possible_experiments(unlimited) if e.name == "slews")
    assert np.abs(slews.recording["torque_command"]).max() == pytest.approx(0.2, rel=0.01)
