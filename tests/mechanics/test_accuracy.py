import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from twin.errors import InputError
from twin.mechanics import accuracy
from twin.mechanics.accuracy import check, to_json
from twin.mechanics.chain_modes import ModeComparison, fit_ring_down
from twin.rigs import preset
from twin.rigs.bossi2009 import FREQUENCIES_HZ


@pytest.fixture(scope="module")
def default():
    return check(preset("bossi2009"))


def test_default_chain_passes(default):
    assert default.segments <= 8
    assert [row for row in default.rows if not row.passed] == []


def test_linearised_mujoco_has_the_analytical_frequencies(default):
    for table in (default.free, default.clamped):
        np.testing.assert_allclose(table.chain, table.analytical, rtol=3e-5)


def test_ring_downs_have_frequency_and_damping(default):
    for table in (default.free, default.clamped):
        np.testing.assert_allclose(table.simulated, table.analytical, rtol=2e-4)
        np.testing.assert_allclose(table.simulated_damping, table.analytical_damping, rtol=0.01)
    assert default.clamped.simulated_damping[0] == pytest.approx(0.0057, rel=0.01)


def test_statics_and_friction(default):
    assert default.compliance[1] == pytest.approx(default.compliance[0], rel=1e-4)
    assert default.creep == 0
    assert default.break_away[1] == pytest.approx(0.0650, abs=2e-4)
    assert default.step_change[0] < 1e-3


def test_shapes_agree(default):
    assert min(default.free.mac.min(), default.clamped.mac.min()) > 0.99


def test_json_has_what_others_read(default):
    content = json.loads(json.dumps(to_json(default, FREQUENCIES_HZ)))
    assert content["rig"] == "bossi2009"
    assert content["passed"] is True
    assert content["published"] == {"f1_hz": 7.27, "f2_hz": 18.21}
    for boundary in ("free", "clamped"):
        for table in ("frequencies_hz", "damping_ratio"):
            assert set(content[table][boundary]) == {"analytical", "chain", "simulated"}
    assert content["static_tip_compliance"]["analytical"] == pytest.approx(0.42**3 / (3 * 0.24957), rel=1e-9)


def test_ring_down_fit_recovers_the_truth():
    time = np.linspace(0, 2, 400)
    swing = 0.3 + 2 * np.exp(-0.04 * 30 * time) * np.cos(30 * np.sqrt(1 - 0.04**2) * time + 0.5)
    assert fit_ring_down(time, swing, 28.0) == pytest.approx((30, 0.04), rel=1e-9)


def test_the_table_has_no_exponents():
    shapes = ModeComparison(*([np.ones(1)] * 6), mac=np.array([1 - 1.7e-4]))
    assert accuracy.text_rows(SimpleNamespace(free=shapes, clamped=shapes))[0][-1] == "0.00017"


def test_rig_without_friction_is_checked_for_the_rest():
    bare = preset("bossi2009").replace(static_friction=0.0, coulomb_friction=0.0)
    result = check(bare, 4)
    assert result.creep is None
    assert to_json(result, FREQUENCIES_HZ)["break_away_nm"] is None


@pytest.mark.parametrize("segments", [1, 49])
def test_impossible_number_of_segments(segments):
    with pytest.raises(InputError, match=f"--segments is {segments}; expected 2 to 48"):
        check(preset("bossi2009"), segments)


def test_command_writes_json_and_prints_the_table(twin, tmp_path):
    code, output, _ = twin("check", "--segments", 6, "--json", "check.json")
    assert code == 0
    assert "1 clamped" in output
    assert json.loads((tmp_path / "check.json").read_text())["segments"] == 6


def test_too_coarse_a_chain_fails_with_1(twin):
    code, output, _ = twin("check", "--segments", 2)
    assert code == 1
    assert "FAILED" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--rig", "bosi2009"], "did you mean 'bossi2009'?"),
        (["--segments", "1"], "expected 2 to 48"),
        (["--segments", "4", "--json", "/nowhere/check.json"], "cannot write /nowhere/check.json"),
    ],
)
def test_bad_input_is_one_message_and_2(twin, arguments, message):
    code, _, error = twin("check", *arguments)
    assert code == 2
    assert error.startswith("Error: ")
    assert message in error


def test_help_needs_nothing_heavy():
    heavy = "{'numpy', 'mujoco', 'scipy', 'numba', 'control'}"
    code = f"import sys, twin.cli; print(sorted({heavy} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
