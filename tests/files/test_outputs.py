"""Results are written over nothing that a command reads, nor over one another."""

import json
import os
from pathlib import Path

import campaign_folder
import pytest

from twin.errors import InputError
from twin.files import whole
from twin.files.outputs import MARKER, ResultsFolder, check_writable

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
    "run into a link": ("run lq-step-120 --csv link", "it is a link to nowhere"),
    "run into a link, as rerun file": ("run lq-step-120 --rrd link", "it is a link to nowhere"),
    "compare into a link": ("compare a.csv b.csv --rrd link", "it is a link to nowhere"),
    "check into a link": ("check --json link", "it is a link to nowhere"),
    "validate into a link": ("validate lqi --report link", "it is a link to nowhere"),
    "plan into a link": ("plan-experiment camp --torque link", "it is a link to nowhere"),
    "diagnose into a link": ("diagnose camp --json link", "it is a link to nowhere"),
    "diagnose into a folder of no place": ("diagnose camp --out link", "it is a link to nowhere"),
    "diagnose below a file": ("diagnose camp --out a.csv/new", "it is a file"),
    "diagnose below a link": ("diagnose camp --out link/new", "it is a link to nowhere"),
    "diagnose over a folder": ("diagnose camp --out taken --force", "taken/run.rrd: it is a folder"),
    "identify into a link": ("identify camp --json link", "it is a link to nowhere"),
    "identify into a folder of no place": ("identify camp --out link", "it is a link to nowhere"),
    "identify over a link": (
        "identify camp --out linked --force",
        "linked/identification.html: it is a link",
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
    (tmp_path / "link").symlink_to("nowhere")
    (tmp_path / "taken" / "run.rrd").mkdir(parents=True)
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "identification.html").symlink_to("../a.csv")
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


# The folder of results

RESULTS = ResultsFolder(
    "diagnosis", {"page": "page.html", "answer": "a.json"}, "a.json", frozenset({"verdict"})
)
OTHER = ResultsFolder("identification", {"page": "page.html", "answer": "b.json"}, "b.json", frozenset())


def test_the_marker_comes_first_and_the_answer_last(tmp_path, monkeypatch):
    order, replace = [], os.replace
    monkeypatch.setattr(os, "replace", lambda old, new: order.append(new.name) or replace(old, new))
    RESULTS.write(tmp_path / "out", {"a.json": "{}", "page.html": ""})
    assert order == [MARKER, "page.html", "a.json"]
    assert json.loads((tmp_path / "out" / MARKER).read_text())["kind"] == "diagnosis"


@pytest.mark.parametrize(
    "there",
    [
        {},
        {whole.temporary_path(Path()).name: "half"},
        {MARKER: '{"kind": "diagnosis"}'},
        {MARKER: '{"kind": "diagnosis"}', "page.html": "new"},
        {MARKER: '{"kind": "diagnosis"}', "a.json": "of a format that is to come"},
        {"page.html": "of an earlier version", "a.json": '{"verdict": "explained"}'},
    ],
    ids=["new", "killed while writing", "marked", "without answer", "other answer", "earlier version"],
)
def test_earlier_and_half_of_the_results_are_written_over(there, tmp_path):
    for name, text in there.items():
        (tmp_path / name).write_text(text)
    assert RESULTS.choose(tmp_path, tmp_path) == tmp_path


@pytest.mark.parametrize(
    "there",
    [
        {"page.html": "mine"},
        {"page.html": "mine", MARKER: "{}"},
        {"page.html": "mine", MARKER: '["diagnosis"]'},
        {"page.html": "of another kind", MARKER: '{"kind": "identification"}'},
        {"page.html": "", "a.json": '{"verdict": 1}', MARKER: '{"kind": "identification"}'},
        {"page.html": "", MARKER: '{"kind": "diagnosis"}', "thesis.tex": "mine"},
    ],
)
def test_what_is_not_marked_as_results_of_this_kind_is_kept(there, tmp_path):
    for name, text in there.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match="which no diagnosis wrote"):
        RESULTS.choose(tmp_path, tmp_path)
    assert RESULTS.choose(tmp_path, tmp_path, force=True) == tmp_path


def test_results_of_two_kinds_do_not_mix_unless_forced(tmp_path):
    RESULTS.write(tmp_path, {"a.json": "{}", "page.html": ""})
    with pytest.raises(InputError, match=r"holds a\.json and more, which no identification wrote"):
        OTHER.choose(tmp_path, tmp_path)
