"""The augmented rig as a file: what is written is read back, what is wrong is named."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_diagnosis as synthetic

from twin.correlations import from_covariance
from twin.errors import InputError
from twin.parameters import Rig
from twin.report.augmented_rig import to_toml, write_augmented
from twin.rigs.rig_file import read_rig_file, read_uncertainty

MINIMAL = """format = 1
name = "mine"
[parameters]
length = 0.4
linear_density = 0.1
bending_stiffness = 0.25
hub_inertia = 0.02
"""


@pytest.fixture(scope="module")
def diagnosis():
    return synthetic.diagnosis(duration=0.4)


def test_round_trip_is_exact(diagnosis, tmp_path):
    path = write_augmented(diagnosis, tmp_path / "new" / "folder")
    rig, effects = read_rig_file(path)
    assert path.name == "augmented-rig.toml"
    assert dict(rig) == dict(diagnosis.fitted)
    assert rig.name == diagnosis.campaign
    assert effects == {"cable-torsion": synthetic.CABLE}


def test_standard_error_becomes_uncertainty(diagnosis, tmp_path):
    rig, _ = read_rig_file(write_augmented(diagnosis, tmp_path))
    stiffness = rig.parameters["bending_stiffness"]
    assert stiffness.uncertainty == pytest.approx(0.0009 / 0.2481)
    assert "fitted to the recordings of bench rig; declared 0.24957" in stiffness.source
    assert rig.parameters["length"].uncertainty == diagnosis.declared.parameters["length"].uncertainty


def test_file_names_units_and_errors(diagnosis):
    text = to_toml(diagnosis)
    assert "stiffness = 0.0101  # N*m/rad, standard error 0.00031" in text
    assert "rest_angle = 0.24  # rad, standard error 0.021" in text


def test_standard_errors_of_effects_are_read_back(diagnosis, tmp_path):
    [effect] = diagnosis.effects
    path = write_augmented(diagnosis, tmp_path)
    assert read_uncertainty(path)[0] == {"cable-torsion": dict(effect.standard_errors)}


def test_correlations_are_read_back(diagnosis, tmp_path):
    names = ("bending_stiffness", "length", "cable-torsion.stiffness")
    covariance = np.array([[4.0, 1.8, 0.0], [1.8, 1.0, -0.1], [0.0, -0.1, 0.25]])
    found = from_covariance(names, covariance)
    _, read = read_uncertainty(write_augmented(replace(diagnosis, correlations=found), tmp_path))
    assert read.names == names
    np.testing.assert_allclose(read.matrix, [[1.0, 0.9, 0.0], [0.9, 1.0, -0.2], [0.0, -0.2, 1.0]], atol=1e-4)
    root = read.root(["length", "tip_mass", "bending_stiffness"])
    np.testing.assert_allclose(root @ root.T, [[1.0, 0.0, 0.9], [0.0, 1.0, 0.0], [0.9, 0.0, 1.0]], atol=1e-4)


def test_no_correlations_are_none(diagnosis, tmp_path):
    assert read_uncertainty(write_augmented(diagnosis, tmp_path))[1].names == ()
    assert from_covariance(["a", "b"], np.diag([1.0, np.inf])).names == ("a",)


def test_odd_names_survive(diagnosis, tmp_path):
    name = 'a "rig"\nwith \\ \x7f ü and \x00'
    odd = replace(diagnosis, campaign=name, fitted=Rig(name, diagnosis.fitted.parameters))
    assert read_rig_file(write_augmented(odd, tmp_path))[0].name == name


def test_no_effects_and_no_torque_limit(tmp_path):
    nothing = synthetic.nothing_missing(duration=0.4)
    endless = replace(nothing, fitted=nothing.fitted.replace(torque_limit=np.inf))
    rig, effects = read_rig_file(write_augmented(endless, tmp_path))
    assert rig["torque_limit"] == np.inf
    assert effects == {}


def test_a_person_may_write_plain_numbers(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL + "[effects.viscous-friction]\nviscous = 1e-3\n")
    rig, effects = read_rig_file(path)
    assert rig["length"] == 0.4
    assert rig["tip_mass"] == 0.0
    assert effects == {"viscous-friction": {"viscous": 1e-3}}


def test_parameters_left_out_of_an_effect_are_neutral(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINIMAL + "[effects.cable-torsion]\nstiffness = 0.01\n")
    assert read_rig_file(path)[1] == {"cable-torsion": {"stiffness": 0.01, "rest_angle": 0.0}}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = ", "rig.toml, at its end: Invalid value; expected a rig as TOML"),
        (MINIMAL.replace("format = 1", "format = 2"), "format is 2; expected format = 1"),
        (MINIMAL.replace("format = 1", "format = true"), "format is true; expected format = 1"),
        (MINIMAL.replace('name = "mine"', ""), "name is missing"),
        (MINIMAL.replace("length = 0.4\n", ""), "length missing"),
        (MINIMAL.replace("length", "lenght"), "parameters.lenght is not a parameter.*did you mean 'length'"),
        (MINIMAL.replace("0.4", "true"), "parameters.length.value is true; expected a number"),
        (MINIMAL.replace("0.4", "nan"), "parameters.length.value is nan; expected a number"),
        (MINIMAL.replace("0.4", "-0.4"), "parameters.length: length is -0.4 m; expected 0.001 to 100"),
        (
            MINIMAL.replace("0.4", '{value = 400.0, unit = "mm"}'),
            "parameters.length.unit is 'mm'; expected 'm'",
        ),
        (MINIMAL.replace("0.4", "{valu = 0.4}"), "unknown key parameters.length.valu.*did you mean 'value'"),
        (MINIMAL.replace("0.4", "{value = 0.4, standard_error = -1}"), "standard_error is -1"),
        (
            MINIMAL.replace("0.4", "{value = 0.4, uncertainty = -1}"),
            "parameters.length.uncertainty is -1; expected a number >= 0",
        ),
        (MINIMAL + "[effects.cable-torsoin]\n", "not an effect.*did you mean 'cable-torsion'"),
        (MINIMAL + "[effects.cable-torsion]\nstifness = 1\n", "unknown key effects.cable-torsion.stifness"),
        (MINIMAL + "[effects.cable-torsion]\nstiffness = 'x'\n", "stiffness is 'x'; expected a number"),
        (MINIMAL + "[effects.cable-torsion]\nstiffness = inf\n", "stiffness is inf; expected a finite"),
        (MINIMAL + "[correlations]\nof = ['length']\n", r"expected of = \[names\] and matrix = \[rows\]"),
        (MINIMAL + "[correlations]\nof = ['foo']\nmatrix = [[1]]\n", "'foo' is no number of the rig"),
        (
            MINIMAL + "[correlations]\nof = ['length', 'tip_mass']\nmatrix = [[1, 2], [2, 1]]\n",
            "numbers from -1",
        ),
        (
            MINIMAL + "[correlations]\nof = ['length', 'tip_mass']\nmatrix = [[1, 0.5], [0, 1]]\n",
            "not symmetric",
        ),
        (
            MINIMAL
            + "[correlations]\nof = ['length', 'tip_mass', 'tip_inertia']\n"
            + "matrix = [[1, 0.9, 0.9], [0.9, 1, -0.9], [0.9, -0.9, 1]]\n",
            "expected none below 0",
        ),
        (MINIMAL + "[standard_errors.cogging]\n", "standard_errors.cogging is of no effect of the rig"),
        (
            MINIMAL + "[effects.torque-bias]\nbias=1e-3\n[standard_errors.torque-bias]\nbias = -1\n",
            "standard_errors.torque-bias.bias is -1; expected a number >= 0",
        ),
        (MINIMAL + "[efects]\n", "unknown key efects.*did you mean 'effects'"),
        (MINIMAL.replace("[parameters]", "effects = 3\n[parameters]"), "effects is 3; expected a table"),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"(?s)rig.toml.*{message}|{message}"):
        read_rig_file(path)


def test_missing_and_binary_files_are_named(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        read_rig_file(tmp_path / "none.toml")
    with pytest.raises(InputError, match="is a folder; expected a rig as a TOML file"):
        read_rig_file(tmp_path)
    (tmp_path / "rig.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="rig.toml, line 1: byte 0xff is not UTF-8; save the file as UTF-8$"):
        read_rig_file(tmp_path / "rig.toml")
