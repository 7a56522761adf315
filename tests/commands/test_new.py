"""`twin new`: the campaign that it writes, and what it never writes over."""

import json
import shutil
import sys
import tomllib
from pathlib import Path

import campaign_folder
import numpy as np
import pytest
from paths import ROOT

from twin.commands import new
from twin.commands.shared import console

DEMO = ROOT / "twin" / "data" / "demo-rig"


@pytest.fixture
def files(tmp_path):
    """Two recordings in a folder of their own."""
    folder = tmp_path / "bench"
    folder.mkdir()
    for name in ("bang-bang-30.csv", "free-vibration.csv"):
        shutil.copy(DEMO / name, folder)
    return sorted(folder.iterdir())


@pytest.fixture
def run(twin, monkeypatch, tmp_path):
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    return twin


def test_a_campaign_is_written_with_copies_of_its_files(run, files):
    code, output, error = run("new", *files, "--yes")
    assert (code, error) == (0, "")
    folder = Path("bench-campaign")
    assert sorted(p.name for p in folder.iterdir()) == [
        "bang-bang-30.csv",
        "campaign.toml",
        "free-vibration.csv",
    ]
    assert (folder / files[0].name).read_bytes() == files[0].read_bytes()
    assert "Fill in there: parameters.bending_stiffness" in output
    assert output.endswith("Then: twin data bench-campaign\n")
    code, output, error = run("diagnose", folder)
    assert (code, output) == (2, "")
    assert "missing: bending_stiffness, linear_density, length, hub_inertia" in error


def test_json_is_the_proposal(run, files):
    assert run("new", *files, "--yes", "--json", "proposal.json")[0] == 0
    said = json.loads(Path("proposal.json").read_text(encoding="utf-8"))
    written = tomllib.loads(Path("bench-campaign/campaign.toml").read_text(encoding="utf-8"))
    assert said["channels"].keys() - {"time"} == written["channels"].keys() - {"time"}
    assert [entry["file"] for entry in said["recordings"]] == [file.name for file in files]
    assert "parameters.bending_stiffness" in said["missing"]
    code, _, error = run("new", *files, "--out", "other", "--json", "other/campaign.toml")
    assert code == 2
    assert "cannot write other/campaign.toml" in error


def test_nothing_is_asked_without_standard_input(run, files, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert run("new", *files)[0] == 0


def test_files_in_the_folder_stay_where_they_are(run, files):
    assert run("new", *files, "--out", files[0].parent)[0] == 0
    assert sorted(p.name for p in files[0].parent.iterdir()) == sorted(
        ["campaign.toml", *(p.name for p in files)]
    )


def test_nothing_is_written_over(run, files, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / files[0].name).write_text("mine")
    code, _, error = run("new", *files, "--out", out)
    assert code == 2
    assert "is not written over it; name another folder with --out" in error
    assert [p.name for p in out.iterdir()] == [files[0].name]
    (out / "campaign.toml").write_text("mine")
    code, _, error = run("new", *files, "--out", out)
    assert code == 2
    assert "has a campaign.toml, which is not written over" in error
    assert (out / "campaign.toml").read_text() == "mine"


def test_files_of_one_name_get_that_of_their_folder(run, files, tmp_path):
    other = tmp_path / "tuesday" / files[0].name
    other.parent.mkdir()
    shutil.copy(DEMO / "bang-bang-60.csv", other)
    code, output, error = run("new", files[0], other, "--out", "new")
    assert (code, error) == (0, "")
    assert sorted(p.name for p in Path("new").iterdir()) == [
        "bench-bang-bang-30.csv",
        "campaign.toml",
        "tuesday-bang-bang-30.csv",
    ]
    assert Path("new", "tuesday-bang-bang-30.csv").read_bytes() == other.read_bytes()
    told = tomllib.loads(Path("new", "campaign.toml").read_text())["recordings"]
    assert [entry["file"] for entry in told] == ["bench-bang-bang-30.csv", "tuesday-bang-bang-30.csv"]
    assert "tuesday-bang-bang-30.csv" in output


def test_one_file_named_twice_is_refused(run, files):
    code, _, error = run("new", files[0], files[0])
    assert code == 2
    assert "have the same name; expected another one for each" in error
    assert not list(Path().iterdir())


@pytest.mark.parametrize("content", ["", "x,y\n1,2\n", "\0"])
def test_what_is_no_recording_is_told_and_nothing_written(run, tmp_path, content):
    (tmp_path / "a.csv").write_text(content)
    code, output, error = run("new", tmp_path / "a.csv")
    assert (code, output) == (2, "")
    assert "a.csv" in error
    assert not list(Path().iterdir())


def test_a_static_test_is_copied(run, files, tmp_path):
    (tmp_path / "static.csv").write_text("tip_force,tip_deflection\n0,0\n1,0.01\n2,0.02\n")
    assert run("new", *files, tmp_path / "static.csv")[0] == 0
    assert (Path("bench-campaign") / "static.csv").exists()
    assert "static.csv" not in (Path("bench-campaign") / "campaign.toml").read_text()


def test_a_question_is_shown_with_its_brackets(monkeypatch, capsys):
    monkeypatch.setattr("builtins.input", lambda: "0.4")
    assert new._answer(console(), "length [m], [red]column? ") == "0.4"
    assert "length [m], [red]column?" in capsys.readouterr().out


def test_other_formats_are_read(run, tmp_path):
    text = campaign_folder.csv_text(campaign_folder.motion())
    (tmp_path / "a.txt").write_text("# card\n" + text.replace(",", ";").replace(".", ","))
    code, output, _ = run("new", tmp_path / "a.txt", "--out", "new")
    assert code == 0
    assert "hub_angle" in output


def test_a_german_file_with_dates_is_read(run, tmp_path):
    recorded = campaign_folder.motion()
    stamps = np.datetime64("2024-03-01T12:00:00") + (1e6 * recorded["time"]).astype("timedelta64[us]")
    names = {
        "torque_command": "Drehmoment Motor [N*m]",
        "hub_angle": "hub angle [°]",
        "strain_base": "Dehnung für DMS 1",
    }
    rows = [";".join(["Zeit", *names.values()])]
    for k, stamp in enumerate(stamps):
        values = [f"{recorded[channel][k]:.9f}".replace(".", ",") for channel in names]
        rows.append(";".join([str(stamp).replace("T", " "), *values]))
    (tmp_path / "a.csv").write_bytes("\r\n".join(rows).encode("cp1252"))
    code, output, error = run("new", tmp_path / "a.csv", "--out", "new", "--yes")
    assert (code, error) == (0, "")
    written = tomllib.loads(Path("new/campaign.toml").read_text(encoding="utf-8"))["channels"]
    assert (written["time"]["column"], written["time"]["unit"]) == ("Zeit", "s")
    assert written["hub_angle"]["column"] == "hub angle [°]"
