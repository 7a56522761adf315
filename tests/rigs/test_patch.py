"""A correction without a cause: recovered from what is left, and looked up in a simulation."""

import json

import numpy as np
import pytest
from marks import slow_except

from twin.control import plants
from twin.control.plants.base import READINGS
from twin.control.plants.sensor_effects import SensorEffects
from twin.errors import InputError
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import HUB_TORQUE, Recording, Sensor
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.patch import Patch, fit_lookup, read_patch, to_csv
from twin.rigs.simulate import simulate

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
    found = fit_lookup(left, angle, random.integers(0, 4, 6000), HUB_TORQUE, "hub_angle")
    assert found.x[0] == pytest.approx(-1, abs=0.1)
    assert np.abs(found.y - 0.01 * np.sin(3 * found.x)).max() < 1.5e-3
    assert found.count.sum() == pytest.approx(6000, rel=0.05)


def test_what_one_recording_alone_saw_is_no_support():
    random = np.random.default_rng(6)
    angle = random.uniform(0, 2, 4000)
    recording = np.where(angle > 1.2, 0, random.integers(0, 3, 4000))
    found = fit_lookup(0.01 * angle, angle, recording, HUB_TORQUE, "hub_angle")
    assert found.x[-1] < 1.25
    assert fit_lookup(angle[:50], angle[:50], recording[:50], HUB_TORQUE, "hub_angle") is None


def test_a_looked_up_spring_moves_as_the_effect_that_it_is():
    """A straight line in the hub's angle is a cable: the patch must move the hub as that effect does."""
    cable = MODEL.replace(effects={"cable-torsion": {"stiffness": 0.02, "rest_angle": 0.1}})
    patched = MODEL.replace(patch=lookup(HUB_TORQUE, "hub_angle", [-9, 9], [0.02 * 9.1, -0.02 * 8.9]))
    one, other = (simulate(m, slew(), Start())["hub_angle"] for m in (cable, patched))
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert np.abs(one - simulate(MODEL, slew(), Start())["hub_angle"]).max() > 0.01


def test_looked_up_by_rate_and_time_it_is_friction_and_a_bias():
    viscous = MODEL.replace(effects={"viscous-friction": {"viscous": 0.004}})
    by_rate = MODEL.replace(patch=lookup(HUB_TORQUE, "hub_rate", [-50, 50], [0.2, -0.2]))
    biased = MODEL.replace(effects={"torque-bias": {"bias": 0.01}})
    by_time = MODEL.replace(patch=lookup(HUB_TORQUE, "time", [0, 9], [0.01, 0.01]))
    for one, other in ((viscous, by_rate), (biased, by_time)):
        angles = [simulate(m, slew(), Start())["hub_angle"] for m in (one, other)]
        np.testing.assert_allclose(*angles, atol=1e-9)


def test_looked_up_by_the_command_it_is_a_gain():
    weak = MODEL.replace(effects={"torque-gain": {"gain": 0.9}})
    patched = MODEL.replace(patch=lookup(HUB_TORQUE, "torque_command", [-1, 1], [0.1, -0.1]))
    angles = [simulate(m, slew(), Start())["hub_angle"] for m in (weak, patched)]
    np.testing.assert_allclose(*angles, atol=1e-9)


def test_a_reading_is_changed_by_its_own_value():
    clipped = MODEL.replace(patch=lookup("strain_base", "strain_base", [-1, 0, 1], [1, 0, -1]))
    plain, bent = (simulate(m, slew(), Start()) for m in (MODEL, clipped))
    np.testing.assert_allclose(bent["strain_base"], 0.0, atol=1e-12)
    np.testing.assert_array_equal(plain["hub_angle"], bent["hub_angle"])


def test_beyond_its_support_it_stays_what_it_was_last():
    patch = lookup(HUB_TORQUE, "hub_angle", [0, 1], [0, 5])
    assert patch.at(np.array([-3.0, 0.5, 7.0])).tolist() == [0.0, 2.5, 5.0]


def ran(kind, effects=None, patch=None, seconds=0.6):
    """Readings (n x channels) of a plant under two steps of torque, and what its sensors report in the end."""
    plant = plants.make_plant(kind, RIG, effects, patch=patch)
    effects_on_sensors = SensorEffects(plants.make_model(RIG, effects, patch=patch), plant)
    plant.reset()
    rows = []
    for k in range(round(seconds / plant.period)):
        plant.advance(0.15 if k < 60 else -0.1)
        rows.append([effects_on_sensors.read(plant.time(), plant.read())[c] for c in READINGS])
    return np.array(rows)


@pytest.mark.parametrize("kind", slow_except(["chain", "compiled", "modal", "paper"], "chain", "compiled"))
@pytest.mark.parametrize(
    ("effects", "patch"),
    [
        (
            {"cable-torsion": {"stiffness": 0.02, "rest_angle": 0.1}},
            (HUB_TORQUE, "hub_angle", [-9, 9], [0.182, -0.178]),
        ),
        ({"viscous-friction": {"viscous": 0.004}}, (HUB_TORQUE, "hub_rate", [-50, 50], [0.2, -0.2])),
        ({"torque-bias": {"bias": 0.01}}, (HUB_TORQUE, "time", [0, 9], [0.01, 0.01])),
        ({"torque-gain": {"gain": 0.9}}, (HUB_TORQUE, "torque_command", [-1, 1], [0.1, -0.1])),
        ({"hub-sensor-gain": {"gain": 1.1}}, ("hub_angle", "hub_angle", [-9, 9], [-0.9, 0.9])),
        ({"strain-drift": {"rate_base": 1e-5, "rate_mid": 0.0}}, ("strain_base", "time", [0, 9], [0, 9e-5])),
    ],
)
def test_every_plant_has_a_patch_as_the_effect_that_it_is(kind, effects, patch):
    # A torque sensor feels the bias of a drive, and nothing that acts on the hub beside it.
    felt = [c for c in READINGS if c != "motor_torque" or "torque-bias" not in effects]
    runs = ran(kind, effects), ran(kind, patch=lookup(*patch)), ran(kind)
    expected, found, without = (run[:, [READINGS.index(c) for c in felt]] for run in runs)
    size = np.abs(expected - without).max(axis=0)
    assert size.max() > 1e-6
    np.testing.assert_allclose(found, expected, atol=2e-3 * size.max(), rtol=2e-3)
    assert np.all(np.abs(found - expected).max(axis=0) <= 0.02 * size + 1e-9)


def test_a_lookup_is_read_as_it_was_written(tmp_path):
    patch = lookup(HUB_TORQUE, "hub_angle", [-0.5, 0.1, 1.25], [0.004, -1.23456789e-3, 0])
    (tmp_path / "patch.csv").write_text(to_csv(patch))
    found = read_patch(tmp_path / "patch.csv")
    assert (found.channel, found.variable) == (HUB_TORQUE, "hub_angle")
    np.testing.assert_allclose([found.x, found.y, found.count], [patch.x, patch.y, patch.count])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "hub_angle,samples\n0,1\n1,1\n",
            "line 1: columns are hub_angle, samples; expected a variable, added_to_CH",
        ),
        (
            "hub_angle,added_to_hub_torqu\n0,1\n1,1\n",
            "line 1: nothing can be added to 'hub_torqu'; .*did you mean",
        ),
        (
            "tip_rate,added_to_hub_torque\n0,1\n1,1\n",
            "line 1: no simulation looks up hub_torque by 'tip_rate'",
        ),
        ("hub_angle,added_to_hub_torque\n0,1\n", "has 1 points after its header; expected at least 2"),
        ("hub_angle,added_to_hub_torque\n0,1\n1,\n", "line 3: a number is missing"),
        (
            "hub_angle,added_to_hub_torque\n0,1\n1,1e9\n",
            r"line 3: added_to_hub_torque is 1e\+09 N\*m; expected -1000",
        ),
        (
            "hub_angle,added_to_hub_torque\n0,1\n0,2\n",
            "line 3: 0 follows 0; expected the variable to increase",
        ),
    ],
)
def test_what_is_no_lookup_is_refused(tmp_path, text, said):
    (tmp_path / "patch.csv").write_text(text)
    with pytest.raises(InputError, match=f"patch.csv.*{said}"):
        read_patch(tmp_path / "patch.csv")


def test_a_run_takes_a_lookup_and_says_that_it_is_none_of_its_physics(twin, tmp_path):
    (tmp_path / "patch.csv").write_text(to_csv(lookup(HUB_TORQUE, "hub_rate", [-50, 50], [0.2, -0.2])))
    arguments = ("run", "bang-bang-20", "--plant", "compiled", "--json")
    code, _, _ = twin(*arguments, "without.json")
    assert code == 0
    code, output, _ = twin(*arguments, "with.json", "--patch", "patch.csv")
    assert code == 0
    assert "With a patch, which is no physics: hub torque by hub rate" in output
    without, patched = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("without", "with"))
    assert "patch" not in without
    assert patched["metrics"] != without["metrics"]


def test_a_run_refuses_the_patch_of_a_sensor_that_plants_lack(twin, tmp_path):
    (tmp_path / "patch.csv").write_text(to_csv(lookup("tip_acceleration", "time", [0, 9], [0, 1])))
    code, _, errors = twin("run", "bang-bang-20", "--plant", "compiled", "--patch", "patch.csv")
    assert code == 2
    assert "the patch of tip_acceleration by time has no place in a plant" in errors


def test_a_lookup_is_not_written_over(twin, tmp_path):
    text = to_csv(lookup(HUB_TORQUE, "hub_rate", [-50, 50], [0.2, -0.2]))
    (tmp_path / "patch.csv").write_text(text)
    code, _, _ = twin(
        "run", "bang-bang-20", "--plant", "compiled", "--patch", "patch.csv", "--csv", "patch.csv"
    )
    assert code == 2
    assert (tmp_path / "patch.csv").read_text() == text


def test_time_counts_from_the_start_of_a_recording():
    """The same run, its clock 100 s ahead."""
    model = MODEL.replace(
        patch=lookup(HUB_TORQUE, "time", [0, 1.5], [0.02, -0.02]),
        effects={"strain-drift": {"rate_base": 1e-5, "rate_mid": 0.0}},
    )
    late = slew()
    late = late.replace(time=late.time + 100.0)
    one, other = (simulate(model, r, Start()) for r in (slew(), late))
    np.testing.assert_allclose(one["hub_angle"], other["hub_angle"], atol=1e-7)
    np.testing.assert_allclose(one["strain_base"], other["strain_base"], atol=1e-9)
