"""Results are written over nothing that a command reads, nor over one another."""

import os
from pathlib import Path

import campaign_folder
import pytest

from twin.errors import InputError
from twin.files.outputs import ResultsFolder, check_writable

CASES = {
    "compare over its first file": ("compare a.csv b.csv --rrd a.csv", "a.csv"),
    "compare over its last file": ("compare a.csv b.csv --json ./b.csv", "b.csv"),
    "compare over a recording of its campaign": (
        "compare a.csv camp/push.csv --rrd camp/pull.csv",
        "camp/pull.csv",
    ),
    "compare, both in one": ("compare a.csv b.csv --rrd new --json new", "another result"),
    "run over its ghost": ("run lq-step-120 --ghost a.csv --rrd a.csv", "a.csv"),
    "run over its ghost, by another name": (
        "run lq-step-120 --ghost a.csv --rrd x --csv camp/../a.csv",
        "camp/../a.csv",
    ),
    "run, all in one": ("run lq-step-120 --csv new --json new", "another result"),
    "run over its controller": ("run lq-step-120 --controller law.py:law --json law.py", "law.py"),
    "run over its rig": ("run lq-step-120 --rig rig.toml --csv rig.toml", "rig.toml"),
    "check over its rig": ("check --rig rig.toml --json rig.toml", "rig.toml"),
    "check into nothing": ("check --json none/check.json", "there is no folder none"),
    "validate over its limits": ("validate lqi --requirements limits.toml --json limits.toml", "limits.toml"),
    "validate over its controller": ("validate law.py:law --report law.py", "law.py"),
    "validate over its rig": ("validate lqi --rig rig.toml --report rig.toml", "rig.toml"),
    "validate over its campaign": (
        "validate lqi --campaign camp --json camp/campaign.toml",
        "camp/campaign.toml",
    ),
    "validate, both in one": ("validate lqi --json new --report new", "another result"),
    "plan over a recording": ("plan-experiment camp --torque camp/push.csv", "camp/push.csv"),
    "plan, both in one": ("plan-experiment camp --torque new --json new", "another result"),
    "diagnose over a recording": ("diagnose camp --json camp/push.csv", "camp/push.csv"),
    "diagnose over its report": ("diagnose camp --out new --json new/report.html", "new/report.html"),
    "diagnose over its rig": ("diagnose camp --rig rig.toml --json rig.toml", "rig.toml"),
    "diagnose over its rig, in the folder": (
        "diagnose camp --out . --force --rig augmented-rig.toml",
        "augmented-rig.toml",
    ),
    "identify over a recording": ("identify camp --json camp/push.csv", "camp/push.csv"),
    "identify over the other campaign": (
        "identify camp --against other --json other/pull.csv",
        "other/pull.csv",
    ),
    "identify over its page": ("identify camp --out new --json new/identification.html", "another result"),
}


@pytest.fixture
def files(twin, tmp_path):
    """A folder with runs, a controller, a rig, limits and two campaigns, of which nothing may be written over."""
    for name in ("a.csv", "b.csv", "law.py", "rig.toml", "augmented-rig.toml", "limits.toml"):
        (tmp_path / name).write_text(f"this is {name}")
    for name in ("camp", "other"):
        (tmp_path / name).mkdir()
        campaign_folder.write(tmp_path / name)
    return tmp_path


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("case", CASES)
def test_nothing_is_written_over_what_is_read_or_written(twin, files, case):
    arguments, said = CASES[case]
    before = content(files)
    code, out, error = twin(*arguments.split())
    assert (code, out) == (2, "")
    assert error.startswith("Error: cannot write ")
    assert error.count("\n") == 1
    assert said in error
    assert content(files) == before


def test_a_link_to_an_input_is_that_input(files):
    Path("soft").symlink_to("a.csv")
    os.link("a.csv", "hard")
    for name in ("soft", "hard"):
        with pytest.raises(InputError, match=f"cannot write {name}: it is a.csv, which is read"):
            check_writable(Path(name), read=[Path("a.csv")])


def test_what_is_no_file_may_take_everything():
    check_writable(Path(os.devnull), Path(os.devnull))


def test_an_answer_may_go_where_the_folder_has_it_anyway(tmp_path):
    results = ResultsFolder("diagnosis", {"report": "page.html", "answer": "a.json"}, "a.json", frozenset())
    own = results.output_files(tmp_path, tmp_path / "a.json")
    assert own == (tmp_path / "page.html",)
    check_writable(tmp_path / "a.json", made=tmp_path, beside=own)
    with pytest.raises(InputError, match=r"another result goes to"):
        check_writable(tmp_path / "a.json", made=tmp_path, beside=results.output_files(tmp_path))
