"""Rigs as files of other programs: the linear model is that of the chain at rest, and the FMU is the chain."""

import io
import json
import math
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import lsim, lti

from twin.api.simulation import model as rig_model
from twin.commands.shared import load_rig
from twin.control.plants import make_model
from twin.control.plants.base import READINGS
from twin.errors import InputError
from twin.export import EXPORTERS, RigToExport, exporter_of
from twin.export.linear import linear_model
from twin.export.stepped_rig import SteppedRig
from twin.parameters import Rig
from twin.recording import CHANNEL_UNITS
from twin.rigs import preset

RIG = preset("bossi2009")
FRICTION = ("static_friction", "coulomb_friction")
SMOOTH = Rig("smooth", {n: replace(p, value=0.0) if n in FRICTION else p for n, p in RIG.parameters.items()})
"""Without dry friction."""
HELD = {
    "cogging": {"amplitude": 0.01, "order": 8.0, "phase": 0.3},
    "cable-torsion": {"stiffness": 0.05, "rest_angle": 0.1},
    "gravity-tilt": {"tilt": 0.02, "direction": 1.1},
    "torque-bias": {"bias": 0.004},
    "torque-gain": {"gain": 1.1},
    "viscous-friction": {"viscous": 0.002},
    "strain-gain": {"gain_base": 1.2, "gain_mid": 0.9},
}
RIG_FILE = """
format = 1
name = "bench"
[parameters]
length = 0.4
linear_density = 0.3
bending_stiffness = 0.25
hub_inertia = 0.0005
static_friction = 0.02
coulomb_friction = 0.012
torque_limit = 0.3
[effects.cogging]
amplitude = 0.01
order = 8.0
phase = 0.3
"""


def test_a_small_step_about_a_hub_angle_moves_the_chain_as_the_linear_model():
    model, angle, step, push = make_model(SMOOTH, HELD), 0.5, 1e-3, 1e-4
    linear = linear_model(model, angle)
    rig, chain = SteppedRig(model, angle), []
    for _ in range(400):
        rig.advance(linear.command + push, step)
        chain.append(list(rig.readings.values()))
    time = step * np.arange(401)
    _, moved, _ = lsim(lti(linear.A, linear.B, linear.C, linear.D), np.full(401, push), time)
    expected = (linear.readings + moved)[1:]
    for k, name in enumerate(READINGS):
        span = np.ptp(expected[:, k])
        np.testing.assert_allclose(np.array(chain)[:, k], expected[:, k], atol=5e-3 * span, err_msg=name)


def test_a_lag_of_the_drive_is_a_state():
    linear = linear_model(make_model(RIG, {"actuator-lag": {"time_constant": 0.02}}))
    assert linear.states[-1] == "torque"
    assert min(abs(np.linalg.eigvals(linear.A) + 1 / 0.02)) < 1e-6
    torque = lti(linear.A, linear.B, linear.C[-1:], linear.D[-1:])
    _, settling = torque.step(T=np.array([0.0, 0.02]))
    np.testing.assert_allclose(settling, [0.0, 1 - math.exp(-1)], atol=1e-9)


def test_delays_and_what_has_no_linear_form_are_told():
    effects = {
        "actuator-delay": {"delay": 0.004},
        "sensor-delay": {"delay": 0.003, "hub_angle": 1.0, "strain": 0.0, "motor_torque": 0.0},
        "dead-zone": {"half_width": 0.01},
        "backlash": {"gap": 0.01, "motor_inertia_share": 0.3},
    }
    linear = linear_model(make_model(RIG, effects))
    assert linear.input_delay == pytest.approx(0.004)
    np.testing.assert_allclose(linear.output_delays, [0.003, 0, 0, 0, 0], atol=1e-9)
    assert set(linear.left_out) == {
        "dry friction of the hub",
        "limit of the command",
        "dead-zone",
        "backlash",
    }


def test_a_disturbance_in_time_is_named_as_left_out():
    effects = {"periodic-disturbance": {"amplitude": 0.01, "frequency": 3.0}}
    assert "periodic-disturbance" in linear_model(make_model(RIG, effects)).left_out


def test_a_matlab_file_holds_the_model_with_names_and_units():
    given = RigToExport(RIG, HELD, 0.5)
    read = loadmat(io.BytesIO(exporter_of(Path("a.mat")).export(given).content))
    for name in ("A", "B", "C", "D"):
        np.testing.assert_array_equal(read[name], getattr(given.linear, name))
    assert [str(cell[0][0]) for cell in read["OutputName"]] == list(READINGS)
    assert [str(cell[0][0]) for cell in read["OutputUnit"]] == ["rad", "m", "1", "1", "N*m"]
    assert len(read["StateName"]) == len(read["A"])
    assert float(read["hub_angle"].item()) == 0.5
    assert float(read["u0"].item()) == given.linear.command


def test_a_script_has_the_same_numbers():
    given = RigToExport(RIG, HELD, 0.5)
    text = exporter_of(Path("a.m")).export(given).content
    assert text.isascii()
    assert "np." not in text
    for name in ("A", "B", "C", "D"):
        body = re.search(rf"^{name} = \[(.*?)^\];", text, re.MULTILINE | re.DOTALL).group(1)
        rows = [[float(cell) for cell in line.split()] for line in body.strip().splitlines()]
        np.testing.assert_array_equal(rows, getattr(given.linear, name))
    assert f"static_friction = [{RIG['static_friction']!r} {RIG['static_friction']!r}];" in text


def test_python_control_gets_the_names():
    system = linear_model(make_model(RIG)).to_control()
    assert system.output_labels == list(READINGS)
    assert system.nstates == 18


def test_the_python_interface_exports_too(tmp_path):
    bench = rig_model("bossi2009", {"cable-torsion": HELD["cable-torsion"]})
    assert bench.state_space(0.2).nstates == 26
    assert bench.export(tmp_path / "rig.m", hub_angle=0.2).read_text().startswith("% bossi2009 linearised")


@pytest.fixture
def rig_file(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG_FILE, encoding="utf-8")
    return "rig.toml"


def test_the_command_writes_each_format_of_text(twin, rig_file):
    for name, begin in (("rig.m", b"% bench linearised"), ("rig.xml", b"<!--"), ("rig.mat", b"MATLAB 5.0")):
        code, output, error = twin("export", rig_file, "--out", name, "--hub-angle", 30)
        assert (code, error) == (0, "")
        assert output.startswith(f"{name}: bench as ")
        assert Path(name).read_bytes().startswith(begin)
    assert mujoco.MjModel.from_xml_path("rig.xml").nu >= 1


def test_json_says_what_was_written(twin, rig_file):
    assert twin("export", rig_file, "--out", "rig.xml", "--json", "rig.json")[0] == 0
    said = json.loads(Path("rig.json").read_text(encoding="utf-8"))
    assert (said["file"], said["rig"], said["format"]) == ("rig.xml", "bench", "mjcf")
    assert said["left_out"] == list(
        exporter_of(Path("rig.xml")).export(RigToExport(*load_rig(rig_file))).left_out
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "rig.slx"), "rig.slx ends in '.slx'; expected one of: .mat (linear state space"),
        (("--out", "rig.mat", "--format", "matlap"), "--format is 'matlap'; expected one of: mat, matlab"),
        (("--out", "rig.toml"), "cannot write rig.toml: it is rig.toml, which is read"),
        (("--out", "nowhere/rig.mat"), "there is no folder nowhere"),
        (("--out", "rig.mat", "--hub-angle", "1e4"), "--hub-angle"),
    ],
)
def test_bad_input_is_one_message(twin, rig_file, arguments, message):
    code, _, error = twin("export", rig_file, *arguments)
    assert code == 2
    assert message in error
    assert sorted(path.name for path in Path().iterdir()) == ["rig.toml"]


def test_each_format_has_a_name_and_an_ending_of_its_own():
    assert len({e.name for e in EXPORTERS}) == len({e.suffix for e in EXPORTERS}) == len(EXPORTERS)


def test_without_pythonfmu_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pythonfmu.builder", None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[fmu\]'"):
        exporter_of(Path("a.fmu")).export(RigToExport(RIG, {}))


def test_too_short_steps_are_refused():
    with pytest.raises(InputError, match="expected at least 0.0001 s"):
        SteppedRig(make_model(RIG)).advance(0.0, 1e-5)


@pytest.fixture
def fmu(twin, rig_file):
    pytest.importorskip("pythonfmu")
    assert twin("export", rig_file, "--out", "rig.fmu")[0] == 0
    return "rig.fmu"


def test_an_fmu_holds_what_it_needs(fmu):
    names = zipfile.ZipFile(fmu).namelist()
    assert {"modelDescription.xml", "resources/rig.toml", "resources/twin_rig.py"} <= set(names)
    assert b"needs Python with the package flexlink-twin" in zipfile.ZipFile(fmu).read("modelDescription.xml")


def test_variables_of_an_fmu_have_units_and_the_model_the_name_of_its_rig(fmu):
    root = ElementTree.fromstring(zipfile.ZipFile(fmu).read("modelDescription.xml"))
    assert root.get("modelName") == "bench"
    units = {
        v.get("name"): real.get("unit")
        for v in root.iter("ScalarVariable")
        if (real := v.find("Real")) is not None
    }
    inputs = {"torque_command": "N*m", "hub_angle_start": "rad"}
    readings = {name: None if CHANNEL_UNITS[name] == "1" else CHANNEL_UNITS[name] for name in READINGS}
    assert units == inputs | readings
    assert [child.tag for child in root][:2] == ["CoSimulation", "UnitDefinitions"]
    assert {u for u in units.values() if u} == {u.get("name") for u in root.iter("Unit")}


def test_an_fmu_moves_as_the_compiled_chain(fmu):
    fmpy = pytest.importorskip("fmpy")
    from twin.rigs.rig_file import read_rig_file

    time = 0.002 * np.arange(301)
    torque = np.select([time < 0.2, time < 0.4], [0.1, -0.1], 0.0)
    signal = np.array(list(zip(time, torque, strict=True)), [("time", float), ("torque_command", float)])
    wanted = [*READINGS, "sticks"]
    result = fmpy.simulate_fmu(
        fmu,
        validate=True,
        input=signal,
        stop_time=0.6,
        step_size=0.002,
        output_interval=0.002,
        start_values={"hub_angle_start": 0.3},
        output=wanted,
    )
    rig = SteppedRig(make_model(*read_rig_file("rig.toml")), 0.3)
    rows = [[*rig.readings.values(), rig.sticks]]
    for command in torque[:-1]:
        rig.advance(float(command), 0.002)
        rows.append([*rig.readings.values(), rig.sticks])
    expected = np.array(rows, dtype=float)
    for k, name in enumerate(wanted):
        np.testing.assert_allclose(result[name], expected[:, k], atol=1e-9, err_msg=name)
    assert 0 < expected[:, -1].mean() < 1
    assert np.ptp(expected[:, 0]) > math.radians(1)
