"""The public interface: importable at once, and what the commands do."""

import importlib
import math
import subprocess
import sys

import numpy as np
import pytest
from paths import ROOT

import twin
from twin.api.inputs import RigFile
from twin.api.table import Table
from twin.parameters import Rig

EXAMPLES = ROOT / "docs" / "examples"
DEMO = ROOT / "twin" / "data" / "demo-rig"
LAGGING = RigFile(twin.rig(), {"actuator-lag": {"time_constant": -5}})
"""A rig with a lag that no drive can have."""


def test_import_loads_nothing_heavy():
    code = (
        "import sys, twin; print(sorted(set(sys.modules) & {'numpy', 'mujoco', 'scipy', 'numba', 'typer'}))"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=ROOT
    )
    assert printed.stdout.strip() == "[]"


@pytest.mark.parametrize("name", twin.__all__)
def test_every_public_name_is_there(name):
    assert getattr(twin, name) is not None
    assert name in dir(twin)


def test_an_unknown_name_is_named():
    with pytest.raises(AttributeError, match="module 'twin' has no attribute 'diagnoze'"):
        twin.diagnoze  # noqa: B018


def test_defaults_are_those_of_the_commands():
    import inspect

    from twin.commands.diagnose import diagnose
    from twin.commands.validate import validate

    ours, theirs = inspect.signature(twin.diagnose).parameters, inspect.signature(diagnose).parameters
    assert ours["false_alarm_rate"].default == theirs["false_alarm_rate"].default
    ours, theirs = inspect.signature(twin.validate).parameters, inspect.signature(validate).parameters
    for name in ("rigs", "scenario", "seed"):
        assert ours[name].default == theirs[name].default


def test_a_model_turns_under_a_torque():
    time = np.arange(0.0, 0.5, 2e-3)
    run = twin.model().simulate(time, np.full(len(time), 0.1))
    still = twin.model(effects={"torque-gain": {"gain": 0.5}}).simulate(time, np.full(len(time), 0.1))
    assert run["hub_angle"][-1] > still["hub_angle"][-1]
    assert set(run.measured()) == {"hub_angle", "strain_base", "strain_mid", "tip_deflection", "motor_torque"}


def test_a_released_tip_swings_back():
    time = np.arange(0.0, 0.9, 2e-3)
    run = twin.model().simulate(time, 0 * time, tip_deflection=0.03, clamped=True)
    assert run["tip_deflection"][0] == pytest.approx(0.03, abs=1e-4)
    assert run["tip_deflection"].min() < -0.025


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: twin.rig("bosi2009"), "did you mean 'bossi2009'"),
        (lambda: twin.model("nowhere.toml"), "there is no such file"),
        (lambda: twin.model(effects={"cogging": {"size": 1.0}}), "cogging"),
        (lambda: twin.model().simulate([0.0, 1.0], [0.0]), "expected two vectors of equal length"),
        (lambda: twin.model().simulate([0.0, 1.0], [0.0, 0.0], channels=["hub"]), "'hub' is not simulated"),
        (lambda: twin.run("lq-step-12"), "lq-step-12"),
        (lambda: twin.read_campaign(ROOT / "nowhere"), "nowhere"),
        (lambda: twin.model(effects={"backlash": {"gap": -5}}), "effects.backlash.gap is -5 rad"),
        (lambda: twin.run(effects={"backlash": {"gap": -5}}), "effects.backlash.gap is -5 rad"),
        (lambda: twin.run(effects=["backlash"]), "effects is a list; expected a table"),
        (lambda: twin.run(rig=LAGGING), "effects.actuator-lag.time_constant is -5 s"),
        (lambda: twin.validate("lqi", rig=LAGGING), "effects.actuator-lag.time_constant is -5 s"),
        (lambda: twin.diagnose(DEMO, rig=LAGGING), "effects.actuator-lag.time_constant is -5 s"),
        (lambda: twin.identify(DEMO, rig=twin.rig().replace(length=0.2)), "strain_mid is 0.21 m"),
        (lambda: twin.run(rig={"length": 1.0}), "rig is a table; expected a name"),
        (lambda: twin.run(rig=Rig("bare", {})), "the rig has no bending_stiffness, "),
        (lambda: twin.run(noise=-1), "noise is -1; expected 0 to"),
        (lambda: twin.run(noise=1.5), "noise is 1.5; expected a whole number"),
        (lambda: twin.run(controller=5), "controller is 5"),
        (lambda: twin.run(plant=5), "'5' is not a plant"),
        (lambda: twin.model(segments=1), "segments is 1; expected 2 to 48"),
        (lambda: twin.model(segments=10**9), "segments is 1000000000; expected 2 to 48"),
        (lambda: twin.model(segments=8.0), "segments is 8.0; expected a whole number"),
        (lambda: twin.state_space(modes=0), "modes is 0; expected 1 to 50"),
        (lambda: twin.state_space(modes=10**9), "modes is 1000000000; expected 1 to 50"),
        (lambda: twin.validate("lqi", rigs=0), "rigs is 0; expected 1 to 100000"),
        (lambda: twin.validate("lqi", rigs=10**9), "rigs is 1000000000; expected 1 to 100000"),
        (lambda: twin.validate("lqi", rigs=2.5), "rigs is 2.5; expected a whole number"),
        (lambda: twin.validate("lqi", seed=-1), "seed is -1; expected 0 to"),
        (lambda: twin.diagnose(DEMO, workers=-1), "workers is -1; expected 1 to 1024"),
        (lambda: twin.diagnose(DEMO, workers="2"), "workers is '2'; expected a whole number"),
        (
            lambda: twin.diagnose(DEMO, false_alarm_rate=math.nan),
            "false-alarm rate is nan; expected a number",
        ),
        (lambda: twin.diagnose(DEMO, false_alarm_rate="1 %"), "false-alarm rate is '1 %'; expected a number"),
        (lambda: twin.model().simulate([0.0, math.nan], [0.0, 0.0]), "time has a value that is not finite"),
        (lambda: twin.model().simulate([0.0, 0.1], [0.0, math.inf]), "torque has a value that is not finite"),
        (lambda: twin.model().simulate([0.0, "x"], [0.0, 0.0]), "time is no array of numbers"),
        (
            lambda: twin.model().simulate([0.0, 1e9], [0.0, 0.0]),
            "the duration is 1e\\+09 s; expected 0 to 100000",
        ),
        (lambda: twin.model().simulate([0.0, 0.1], [0.0, 0.0], hub_angle=math.nan), "hub_angle is nan"),
        (lambda: twin.model().simulate([0.0, 0.1], [0.0, 0.0], tip_deflection=5.0), "tip_deflection is 5 m"),
    ],
)
def test_what_cannot_be_used_is_named(call, message):
    with pytest.raises(twin.InputError, match=message):
        call()


def test_the_linear_model_has_the_modes_of_the_beam():
    from twin.mechanics.beam import modes

    system = twin.state_space(modes=2)
    found = np.unique(np.abs(system.poles())[np.abs(system.poles()) > 1].round(6))
    np.testing.assert_allclose(found, modes(twin.rig(), 2).frequencies, rtol=1e-6)
    assert list(system.output_labels) == ["hub_angle", "tip_deflection", "strain_base", "strain_mid"]


def test_a_run_is_written_as_csv_and_for_rerun(tmp_path):
    run = twin.run("bang-bang-45")
    assert run.metrics["hub_max_deg"] > 10
    assert run.save(tmp_path / "run.csv").read_text().startswith("time,")
    assert run.save(tmp_path / "run.rrd").stat().st_size > 1000
    with pytest.raises(twin.InputError, match=r"expected one of: \.csv, "):
        run.save(tmp_path / "run.pdf")


def test_a_table_is_read_by_people_and_programs():
    table = Table.of_rows(("name", "value"), [("a<b", 1.23456789), ("c", None)])
    assert repr(table) == "name  value\na<b   1.2346\nc"
    assert "<td>a&lt;b</td><td>1.2346</td>" in table._repr_html_()
    assert table.to_dict() == {"name": ["a<b", "c"], "value": [1.23456789, None]}
    with pytest.raises(ValueError, match="expected equal ones"):
        Table({"a": (1,), "b": ()})


def test_an_effect_of_ones_own_brakes():
    ends = _example("own_effect").main()
    twin.effects.unregister("eddy-brake")
    assert ends["with the brake"] < ends["without"] - 0.5


def test_the_error_budget_is_a_table_of_models():
    import synthetic_diagnosis

    answer = synthetic_diagnosis.diagnosis(duration=0.4)
    rows = list(twin.Diagnosis(answer, None).error_budget().rows())
    assert [row["model"] for row in rows[:3]] == ["before", "calibrated", "+ cable torsion"]
    budget = answer.predictions["bang-bang-90.csv"].budget["hub_angle"]
    assert (rows[2]["rms_window"], rows[2]["unit"]) == (budget.after.rms_window, "rad")


def test_what_a_diagnosis_was_computed_from_is_told_with_it(monkeypatch):
    import synthetic_diagnosis

    answer = synthetic_diagnosis.diagnosis(duration=0.4)
    monkeypatch.setattr("twin.diagnosis.diagnose.diagnose", lambda *_: answer)
    told = twin.diagnose(DEMO).to_json()["provenance"]
    assert told["command"] is None
    assert {"campaign.toml", "step-120.csv"} <= told["inputs"].keys()
    assert "static.csv" not in told["inputs"]
    assert twin.diagnose(twin.read_campaign(DEMO)).to_json()["provenance"]["inputs"] == {}


def _example(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
