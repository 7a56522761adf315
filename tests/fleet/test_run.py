"""A fleet: every rig gets its answer or its error, none is diagnosed twice, and each is compared with its last."""

import json
import os
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial

import browser
import campaign_folder
import fleet_tasks
import pytest
from fleet_tasks import noted, solved

import twin as api
from twin.commands import fleet as command
from twin.errors import InputError
from twin.executors.processes import processes
from twin.fleet import page, run, text
from twin.fleet.answer import RigAnswer, RigFailure
from twin.fleet.store import FOLDER, PREVIOUS, folder_name


@pytest.fixture
def rigs(tmp_path):
    """Returns a function that writes campaigns of rigs with these names, and returns their folders."""

    def write(*names: str, seed: int = 0):
        made = []
        for name in names:
            folder = tmp_path / "RIGS" / name
            folder.mkdir(parents=True, exist_ok=True)
            toml = campaign_folder.toml_text().replace('"small"', json.dumps(name))
            made.append(campaign_folder.write(folder, toml, push=campaign_folder.motion(seed=seed)))
        return tuple(made)

    return write


def diagnose(campaigns, out, solve=solved, executor: Executor | None = None, **asked):
    """The fleet, and the results in the order in which they came."""
    came = []
    with ThreadPoolExecutor(2) as threads:
        where = executor or threads
        fleet = run.diagnose_fleet(run.Asked(tuple(campaigns), out, **asked), where, came.append, solve)
    return fleet, came


def test_every_rig_has_a_folder_and_the_fleet_a_page_and_json(rigs, tmp_path):
    fleet, came = diagnose(rigs("b", "a"), tmp_path / "out")
    assert [r.rig for r in fleet.rigs] == ["b", "a"]
    assert sorted(r.rig for r in came) == ["a", "b"]
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"a", "b", "fleet.html", "fleet.json"}
    stored = json.loads((tmp_path / "out" / "fleet.json").read_text())
    assert stored["effects"] == {"cable-torsion": ["b", "a"]}
    assert stored["failed"] == 0
    assert stored["rigs"][0]["effects"][0]["not_told_from"] == ["cogging"]
    assert stored["rigs"][0]["changes"] is None


def test_a_rig_that_fails_does_not_stop_the_others(rigs, tmp_path):
    good, bad = rigs("good", "bad")
    (bad / "push.csv").write_text("time,torque_command,hub_angle,strain_base\n0,0,x,0\n")
    nowhere = tmp_path / "RIGS" / "none"
    fleet, _ = diagnose([bad, nowhere, good], tmp_path / "out")
    assert [type(r) for r in fleet.rigs] == [RigFailure, RigFailure, RigAnswer]
    assert "push.csv, line 2" in fleet.failures[0].error
    assert "there is no such folder" in fleet.failures[1].error
    expected = "Of 3 rigs, 1 has a model that lacks something, and bad and none could not be diagnosed."
    assert text.headline(fleet) == expected
    assert expected in page.render(fleet)


def test_of_many_rigs_that_fail_a_few_are_named(rigs, tmp_path):
    nowhere = [tmp_path / "RIGS" / f"none-{k}" for k in range(5)]
    fleet, _ = diagnose([*rigs("good"), *nowhere], tmp_path / "out")
    assert "and none-0, none-1, none-2 and 2 more could not be diagnosed" in text.headline(fleet)


@pytest.mark.parametrize(
    ("solve", "error"),
    [
        (fleet_tasks.refused, "push.csv: nothing moves; expected a motion"),
        (fleet_tasks.failed, "its diagnosis failed: ZeroDivisionError: division by zero"),
    ],
)
def test_a_diagnosis_that_fails_is_the_error_of_its_rig(rigs, tmp_path, solve, error):
    fleet, _ = diagnose(rigs("a"), tmp_path / "out", solve)
    assert [r.error for r in fleet.failures] == [error]


def test_a_killed_process_takes_along_its_rig_alone(rigs, tmp_path):
    with processes(1) as pool:
        fleet, _ = diagnose(rigs("a", "b", "c"), tmp_path / "out", partial(fleet_tasks.killed, rig="b"), pool)
    assert [r.rig for r in fleet.answers] == ["a", "c"]
    assert "the process that diagnosed it ended" in fleet.failures[0].error


def test_an_interrupted_run_goes_on_with_the_rigs_that_have_no_answer(rigs, tmp_path):
    campaigns, out, log = rigs("a", "b", "c"), tmp_path / "out", tmp_path / "log"

    def interrupted(result):
        raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as one, pytest.raises(KeyboardInterrupt):
        run.diagnose_fleet(run.Asked(campaigns, out), one, interrupted, partial(solved, log=log))
    there = {p.parent.name for p in out.glob("*/diagnosis.json")}
    assert 1 <= len(there) < 3
    log.unlink()
    assert FOLDER.choose(out, out) == out  # it is taken for one of results
    fleet, _ = diagnose(campaigns, out, partial(solved, log=log))
    assert {r.rig for r in fleet.answers if r.reused} == there
    assert {rig for rig, _ in noted(log)} == {"a", "b", "c"} - there


def test_other_files_another_rate_and_another_rig_are_diagnosed_anew(rigs, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    solve = partial(solved, log=log)
    diagnose(rigs("a"), out, solve)
    diagnose(rigs("a"), out, solve)
    assert len(noted(log)) == 1
    diagnose(rigs("a"), out, solve, false_alarm_rate=0.05)
    assert len(noted(log)) == 2
    diagnose(rigs("a", seed=7), out, solve, false_alarm_rate=0.05)
    assert len(noted(log)) == 3


def test_an_answer_that_cannot_be_read_is_none(rigs, tmp_path):
    out, log = tmp_path / "out", tmp_path / "log"
    diagnose(rigs("a"), out)
    for broken in ("{", '{"verdict": "explained"}', "[]"):
        (out / "a" / "diagnosis.json").write_text(broken)
        diagnose(rigs("a"), out, partial(solved, log=log))
    assert len(noted(log)) == 3


def test_a_rig_is_compared_with_its_last_campaign_also_when_its_answer_is_there(rigs, tmp_path):
    out = tmp_path / "out"
    first, _ = diagnose(rigs("a"), out)
    assert first.answers[0].previous is None
    later = partial(solved, verdict="no-missing-effect", effects=())
    for fleet in (diagnose(rigs("a", seed=7), out, later)[0], diagnose(rigs("a", seed=7), out, later)[0]):
        assert text.since(fleet.answers[0]) == (
            "verdict explained → no missing effect; cable torsion is gone"
        )
    assert fleet.answers[0].reused
    assert json.loads((out / "a" / PREVIOUS).read_text())["verdict"] == "explained"
    # At another rate it is the same campaign: the one before stays.
    again, _ = diagnose(rigs("a", seed=7), out, later, false_alarm_rate=0.05)
    assert again.answers[0].previous.verdict == "explained"


def test_rigs_of_one_name_are_not_mixed_up(rigs, tmp_path):
    one, other = rigs("a", "b")
    for name in ("A", "fleet.json"):
        text_ = (other / "campaign.toml").read_text()
        (other / "campaign.toml").write_text(text_.replace('name = "b"', f'name = "{name}"'))
        fleet, _ = diagnose([one, other], tmp_path / f"out-{name}")
        assert "expected another name for each rig" in fleet.failures[0].error
        (other / "campaign.toml").write_text(text_)


@pytest.mark.parametrize(
    ("rig", "folder"),
    [
        ("arm 3/left", "arm-3-left"),
        ("../..", "rig"),
        ("..", "rig"),
        ("Prüfstand", "Prüfstand"),
        ("x" * 500, "x" * 100),
    ],
)
def test_a_folder_is_named_after_its_rig_and_stays_inside(rig, folder):
    assert folder_name(rig) == folder


def test_results_of_others_are_not_overwritten(rigs, tmp_path):
    out = tmp_path / "out"
    (out / "a").mkdir(parents=True)
    (out / "a" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="holds a, which no fleet wrote"):
        FOLDER.choose(out, out)
    fleet, _ = diagnose(rigs("a"), out)
    assert "holds mine.txt" in fleet.failures[0].error


def test_an_executor_that_ended_is_told_in_a_sentence(rigs, tmp_path):
    class Gone(Executor):
        def submit(self, *_, **__):
            future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with pytest.raises(InputError, match="what ran the diagnoses has ended"):
        diagnose(rigs("a", "b"), tmp_path / "out", executor=Gone())


def test_a_wrong_rate_is_refused_before_anything_runs(rigs, tmp_path):
    with pytest.raises(InputError, match="false-alarm rate"):
        diagnose(rigs("a"), tmp_path / "out", false_alarm_rate=0.9)
    assert not (tmp_path / "out").exists()


# Page


@browser.needs_chromium
def test_page_fits_a_phone_and_needs_no_network(rigs, tmp_path):
    out = tmp_path / "out"
    diagnose(rigs("a", "b"), out)
    moved = partial(
        solved, calibrated={"hub_inertia": {"declared": 0.02, "fitted": 0.022, "standard_error": 1e-4}}
    )
    fleet, _ = diagnose([*rigs("a", "b", seed=7), tmp_path / ("none" * 30)], out, moved)
    shown = page.render(fleet)
    assert "<script src" not in shown
    assert '<a href="a/report.html">a</a>' in shown
    assert "hub inertia 0.02100 → 0.02200 kg·m² (7.1 σ)" in shown
    browser.assert_readable({"fleet": shown}, tmp_path, figures=0)


def test_names_of_rigs_are_text_on_the_page(rigs, tmp_path):
    [campaign] = rigs("a")
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text().replace('name = "a"', 'name = "<b>a</b> #1"'))
    fleet, _ = diagnose([campaign], tmp_path / "out")
    shown = page.render(fleet)
    assert "&lt;b&gt;a" in shown
    assert 'href="b-a-b-1/report.html"' in shown


# Command and function


@pytest.fixture
def cheap(monkeypatch):
    """Makes the command answer at once, in threads."""
    monkeypatch.setattr(run.diagnose_fleet, "__defaults__", (solved,))
    monkeypatch.setattr(command, "_executor", lambda options, rigs: ThreadPoolExecutor(1))


def test_command_shows_a_line_for_each_rig_and_a_table(twin, rigs, tmp_path, cheap):
    rigs("a", "b")
    code, out, err = twin("diagnose", "RIGS/a", "RIGS/b", "--json", "fleet.json")
    assert code == 0
    assert err.splitlines() == [
        f"[{n} of 2] {r}: explained; cable torsion (92 %); 1 s" for n, r in ((1, "a"), (2, "b"))
    ]
    assert "cable torsion: 2 (a, b)" in out
    assert (tmp_path / "RIGS-fleet" / "fleet.html").exists()
    assert json.loads((tmp_path / "fleet.json").read_text())["failed"] == 0
    code, out, err = twin("diagnose", "RIGS/a", "RIGS/b", "-q")
    assert (code, out, err) == (0, "", "")


def test_command_says_by_its_exit_code_that_a_rig_failed(twin, rigs, cheap):
    rigs("a")
    code, out, err = twin("diagnose", "RIGS/a", "RIGS/none", "-q")
    assert code == 2
    assert (
        err
        == "Error: none (RIGS/none): RIGS/none: there is no such folder; expected a folder with campaign.toml\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--workers", 2, "--scheduler", "tcp://127.0.0.1:1"), "expected one of them"),
        (("--open", "viewer"), "expected --open report for several"),
        (("--json", "RIGS/a/push.csv"), "which is read; name another place"),
        (("--out", "RIGS"), "holds a and more, which no fleet wrote"),
        (("--rig", "none.toml"), "none.toml"),
        (
            ("--scheduler", "foo bar"),
            "'foo bar' is no address; expected the address that `dask scheduler` prints",
        ),
    ],
)
def test_bad_options_are_one_message(twin, rigs, tmp_path, arguments, message):
    if "--scheduler" in arguments:
        pytest.importorskip("distributed", reason="needs Dask: pip install -e '.[fleet]'")
    rigs("a", "b")
    code, out, err = twin("diagnose", "RIGS/a", "RIGS/b", *arguments)
    assert code == 2
    assert err.startswith("Error: ")
    assert err.count("\n") == 1
    assert message in err
    assert sorted(os.listdir(tmp_path)) == ["RIGS"]


def test_function_takes_any_executor(rigs, tmp_path, cheap):
    with ThreadPoolExecutor(1) as pool:
        fleet = api.diagnose_fleet(rigs("a"), tmp_path / "out", executor=pool)
    assert fleet.answers[0].answer.effects[0].name == "cable-torsion"
    with pytest.raises(InputError, match="there are no campaigns"):
        api.diagnose_fleet([], tmp_path / "out")
