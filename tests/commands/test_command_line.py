"""What all commands share: version, silence, completion, old names, and how progress tells what is done and left."""

import os
import re
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
import typer.main
from paths import ROOT

import twin as package
from twin.cli import app
from twin.commands import shared
from twin.commands.screen import set_quiet
from twin.commands.stages import Lines, Stages

COMMANDS = typer.main.get_command(app).commands


def test_version_is_that_of_the_package(twin):
    assert twin("--version") == (0, f"twin {package.__version__}\n", "")


@pytest.fixture
def quiet():
    set_quiet(True)
    yield
    set_quiet(False)


def test_a_quiet_command_writes_its_files_and_shows_nothing(twin, tmp_path):
    for argument in ("--quiet", "-q"):
        assert twin("run", "bang-bang-20", "--plant", "modal", "--out", "a.csv", argument) == (0, "", "")
        assert (tmp_path / "a.csv").stat().st_size > 1000
    code, output, _ = twin("run", "bang-bang-20", "--plant", "modal")
    assert code == 0
    assert "bang-bang-20 on the modal model" in output


def test_silence_may_be_asked_for_before_the_command(twin):
    for argument in ("--quiet", "-q"):
        assert twin(argument, "run", "bang-bang-20", "--plant", "modal") == (0, "", "")
    assert twin("run", "bang-bang-20", "--plant", "modal")[1] != ""


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_no_words_of_python(twin, name):
    code, output, _ = twin(name, "--help")
    assert code == 0
    assert re.findall(r"<(?!campaign>|folder of the)[^>]*>|x>=|list\[|\.\.\.\}", output) == []


def test_help_tells_limits_in_words(twin):
    assert "at least 1]" in " ".join(twin("validate", "--help")[1].split())


@pytest.mark.parametrize(
    "command", ["new", "data", "diagnose", "run", "compare", "export", "identify", "validate"]
)
def test_commands_with_an_answer_write_it_as_json(command):
    assert "--json" in {option for p in COMMANDS[command].params for option in p.opts}


@pytest.mark.parametrize("arguments", [("check", "--rig", "foo"), ("export", "foo", "--out", "a.mat")])
def test_an_unknown_rig_is_told_that_a_file_would_do(twin, arguments):
    assert twin(*arguments)[2] == (
        "Error: 'foo' is neither a preset nor a file; expected one of: bossi2009, bossi2009-printed, or a parameter "
        "file (TOML)\n"
    )


def test_a_quiet_command_still_tells_its_error(twin):
    code, output, error = twin("run", "bang-bang-21", "--quiet")
    assert (code, output) == (2, "")
    assert "'bang-bang-21' is not a scenario" in error


def test_quiet_silences_progress(quiet, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with shared.progress() as report:
        report("calibrating")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_quiet_and_names_its_outputs_alike(name):
    options = [option for p in COMMANDS[name].params for option in p.opts]
    assert "--quiet" in options
    first = {p.opts[0] for p in COMMANDS[name].params}
    assert not first & {"--csv", "--torque", "--noise", "--output", "--html"}


@pytest.mark.parametrize(
    ("command", "old", "new"),
    [("run", "--csv", "--out"), ("run", "--noise", "--seed"), ("plan-experiment", "--torque", "--out")],
)
def test_old_names_still_work(command, old, new):
    [option] = [p for p in COMMANDS[command].params if old in p.opts]
    assert new in option.opts


def completed(line: str) -> list[str]:
    words = line.split(" ")
    environment = {"_TWIN_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-m", "twin.cli"],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("twin di", ["diagnose"]),
        ("twin run lq", ["lq-step-120"]),
        ("twin run lq-step-120 --controller lqi-", ["lqi-zv", "lqi-ei"]),
        ("twin export rig.toml --format ma", ["mat", "matlab"]),
    ],
)
def test_a_shell_completes_commands_and_names(line, offered):
    assert completed(line) == offered


def test_names_that_are_completed_are_those_that_exist():
    from twin.control.laws.library import CONTROLLERS
    from twin.control.plants import KINDS
    from twin.control.scenarios import SCENARIOS
    from twin.export import EXPORTERS
    from twin.rigs import PRESETS

    assert set(shared.CONTROLLER_NAMES) == CONTROLLERS.keys()
    assert set(shared.SCENARIO_NAMES) == SCENARIOS.keys()
    assert set(shared.PLANT_NAMES) == KINDS.keys()
    assert set(shared.RIG_NAMES) == PRESETS.keys()
    assert list(shared.FORMAT_NAMES) == [e.name for e in EXPORTERS]


# Progress


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


STAGES = (("reading", 1.0), ("fitting", 3.0), ("writing", 1.0))


def test_stages_tell_how_many_and_the_time_left():
    clock = Clock()
    stages = Stages(STAGES, clock)
    stages.update("loading")
    assert (stages.line(), stages.left) == ("loading", None)
    stages.update("reading the files")
    assert stages.line() == "1 of 3: reading the files"
    clock.now += 10
    stages.update("fitting the model")
    assert stages.line() == "2 of 3, about 40 s left: fitting the model"
    clock.now += 15
    assert stages.left == pytest.approx(25)
    stages.update("reading again")
    assert stages.line().startswith("2 of 3, about 25 s left: reading again")
    clock.now += 1000
    assert stages.left is None


def test_a_count_in_a_message_tells_the_time_left_too():
    clock = Clock()
    stages = Stages((), clock)
    clock.now += 30
    stages.update("51 of 200 rigs")
    assert stages.line() == "about 2 min left: 51 of 200 rigs"
    inside = Stages(STAGES, clock)
    clock.now += 10
    inside.update("fitting 2 of 3")
    assert inside.left == pytest.approx(10 * (1 - 0.4) / 0.4)


def test_lines_begin_late_and_are_few():
    clock, lines = Clock(), []
    show = Lines(Stages(STAGES, clock), lines.append).update
    show("reading")
    clock.now += 9
    show("fitting 1")
    assert lines == []
    for second in np.arange(1, 41):
        clock.now = 109 + second
        show("fitting more")
    clock.now += 1
    show("writing")
    assert [line.split("]")[0] for line in lines] == ["[10 s", "[40 s", "[50 s"]
    assert lines[-1].startswith("[50 s] 3 of 3, about 1")


@pytest.mark.parametrize("name", ["diagnose", "identify"])
def test_stages_of_long_commands_are_messages_of_the_package(name):
    module = import_module(f"twin.commands.{name}")
    sources = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "twin").rglob("*.py"))
    assert sum(share for _, share in module._STAGES) == pytest.approx(1.0)
    for text, _ in module._STAGES:
        assert re.search(rf'(progress|report)\(f?"{text}', sources), text
