"""What README and docs/ show runs: Python blocks, notebooks, scripts and commands.

The words of every command are held against its parser. Those that take minutes (a diagnosis, an identification, a
validation, a virtual rig) are executed by `make studies`, all others here. One diagnosis of the bundled campaign
serves every block, script and notebook that asks for one.
"""

import base64
import contextlib
import importlib.util
import io
import json
import math
import re
import shlex
import shutil
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import campaign_folder
import fill_readme
import fleet_tasks
import numpy as np
import plotly.graph_objects as go
import pytest
import typer.main
from paths import ROOT
from planted import PLANTED
from test_readme import DOCUMENTS, README, blocks

import twin as package
from twin.campaigns.drive import torque_per_command
from twin.campaigns.schema import DriveEntry
from twin.cli import app
from twin.commands.virtual_rig import parsed_effect
from twin.effects import REGISTRY
from twin.fleet import run as fleet_run
from twin.validation.requirements import read_requirements

EXAMPLES = ROOT / "docs" / "examples"
DEMO = ROOT / "twin" / "data" / "demo-rig"
COMMANDS = typer.main.get_command(app).commands
MINUTES = {"demo", "diagnose", "identify", "plan-experiment", "validate", "view", "virtual-rig"}
"""Commands that take minutes, or open a window."""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LINES = [
    (name, line)
    for name, text in DOCUMENTS.items()
    for line in dict.fromkeys(line for block in blocks(text, "sh") for line in block.splitlines())
    if line.startswith("twin ")
]
PAGES = sorted(
    {
        *ROOT.glob("*.md"),
        *(page for folder in ("docs", "models", "benchmarks") for page in (ROOT / folder).rglob("*.md")),
    }
)
_FILE = re.compile(r"(?<![\w/.-])(?:tests|twin|benchmarks|docs|models)/[\w./-]+\.(?:py|md|toml|jsonl)")
_FIRST = {
    tuple(shlex.split(line, comments=True)): (name, line) for name, line in reversed(LINES)
}  # of a command that several documents show, the first is run
AT_ONCE = [shown for shown in _FIRST.values() if shown[1].split()[1] not in MINUTES][::-1]
LATER = [shown for shown in _FIRST.values() if shown not in AT_ONCE][::-1]

sys.path.insert(0, str(ROOT / "docs" / "tools"))
import build  # noqa: E402
import pages  # noqa: E402


def words(line: str) -> list[str]:
    """The words of a shell line without its comment, file patterns expanded."""
    found = []
    for word in shlex.split(line, comments=True):
        found += sorted(map(str, Path().glob(word))) if "*" in word else [word]
    return found


def assert_accepted(line: str) -> None:
    """The parser of its command accepts a shell line, and the effects that it names exist with their parameters."""
    _, command, *arguments = shlex.split(line, comments=True)
    for text in parsed(command, arguments).get("effect") or ():
        name, values = parsed_effect(text)
        assert values.keys() <= {p.name for p in REGISTRY[name].parameters}


def parsed(command: str, arguments: list[str]) -> dict:
    """The options of a command among arguments.

    Raises what its parser has against them: an unknown option, a missing value, an argument too many.
    """
    context = COMMANDS[command].make_context(command, [], resilient_parsing=True)
    context.resilient_parsing = False
    options, left, _ = COMMANDS[command].make_parser(context).parse_args(arguments)
    assert left == []
    return options


# Commands


@pytest.mark.parametrize(("name", "line"), LINES)
def test_command_lines_are_accepted_by_their_parsers(name, line):
    """Options, their values and the number of arguments, without executing anything."""
    assert_accepted(line)


@pytest.mark.parametrize("name", [*DOCUMENTS, "CONTRIBUTING.md"])
def test_other_lines_of_shell_blocks_name_what_is_there(name):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    text = (ROOT / name).read_text(encoding="utf-8")
    for line in (line for block in blocks(text, "sh") for line in block.splitlines()):
        match shlex.split(line, comments=True):
            case ["twin", *_] | [".venv/bin/rerun", _]:
                pass
            case ["dask", "scheduler"] | ["dask", "worker", *_]:
                pass  # started with these options in tests/executors/test_scheduler.py
            case ["python", script, *_]:
                assert (ROOT / script).is_file(), line
            case ["make", target]:
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), line
            case ["git", "clone", address, "&&", "cd", folder]:
                assert (address, folder) == (PROJECT["urls"]["Homepage"], address.split("/")[-1])
            case [".", ".venv/bin/activate"] | ["rerun", _]:
                pass  # made by `make demo`
            case _:
                pytest.fail(f"{name}: nothing runs {line!r}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_files_of_the_project_that_a_page_names_exist(page):
    named = set(_FILE.findall(page.read_text(encoding="utf-8")))
    assert {path for path in named if not (ROOT / path).is_file()} == set()


@pytest.mark.parametrize("name", ["README.md", "docs/index.md", "docs/your-rig.md"])
def test_the_environment_is_activated_before_the_first_command(name):
    lines = [line for block in blocks(DOCUMENTS[name], "sh") for line in block.splitlines()]
    first = next(k for k, line in enumerate(lines) if line.startswith("twin "))
    assert any(line.startswith(". .venv/bin/activate") for line in lines[:first])


@pytest.mark.parametrize("name", [*DOCUMENTS, "CHANGELOG.md"])
def test_extras_are_installed_from_the_clone(name):
    """The package is in no index."""
    text = (ROOT / name).read_text(encoding="utf-8")
    asked = re.findall(r"pip install (?:-e )?'?([^'`]*)\[(\w+)\]", text)
    assert all(where == "." and extra in PROJECT["optional-dependencies"] for where, extra in asked)


def test_the_readme_names_the_extra_of_the_formats_that_it_promises():
    (promise,) = re.findall(r"^.*Excel, HDF5, TDMS or MCAP.*$", README, re.MULTILINE)
    assert "pip install -e '.[files]'" in promise


def test_a_wrong_option_or_one_argument_too_many_is_found():
    for arguments in (["--nonsense"], ["one", "two"]):
        with pytest.raises(Exception, match="nonsense|left|two"):
            parsed("identify", arguments)


@pytest.fixture
def laboratory(tmp_path, monkeypatch):
    """A folder with the files that the documents speak of."""
    monkeypatch.chdir(tmp_path)
    Path("recordings").mkdir()
    for path in DEMO.glob("*.csv"):
        shutil.copy(path, "recordings")
    for campaign in ("my-rig", "try", "RIGS/arm-3", "RIGS/arm-4"):
        shutil.copytree(DEMO, campaign)
        given = Path(campaign, "campaign.toml")
        text = given.read_text(encoding="utf-8").replace('"demo-rig"', f'"{Path(campaign).name}"', 1)
        given.write_text(text, encoding="utf-8")
    (limits,) = blocks(DOCUMENTS["docs/validation.md"], "toml")
    Path("limits.toml").write_text(limits, encoding="utf-8")
    (known,) = blocks(DOCUMENTS["docs/identification.md"], "toml")
    Path("my-rig.toml").write_text(_rig_file() + known, encoding="utf-8")
    Path("mine.py").write_text(blocks(DOCUMENTS["docs/control.md"], "python")[0], encoding="utf-8")
    for made in ("my-rig-identification/identified-rig.toml", "my-rig-diagnosis/augmented-rig.toml"):
        Path(made).parent.mkdir()
        Path(made).write_text(_rig_file(), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "line"), AT_ONCE)
@pytest.mark.usefixtures("laboratory")
def test_commands_that_take_seconds_do_what_they_say(name, line, twin, monkeypatch):
    given = words(line)[1:]
    if given[0] == "new":
        shutil.rmtree("my-rig")
    monkeypatch.setattr(sys, "stdin", io.StringIO())  # no terminal: nothing is asked
    assert_done(given, *twin(*given))


@pytest.mark.study
@pytest.mark.parametrize(("name", "line"), LATER)
@pytest.mark.usefixtures("laboratory")
def test_commands_that_take_minutes_do_what_they_say(name, line, twin):
    given = words(line)[1:]
    written = {"virtual-rig": "try", "identify": "my-rig-identification", "diagnose": "my-rig-diagnosis"}
    if given[0] in written:
        shutil.rmtree(written[given[0]])
    with contextlib.ExitStack() as stack:
        if "--scheduler" in given:
            given[given.index("--scheduler") + 1] = stack.enter_context(_cluster())
        code, printed, error = twin(*given)
    if given[0] == "validate":
        assert code in (0, 1)  # 1: too few rigs keep the limits
        assert re.search(r"[\d.]+ % of rigs keep every limit", printed)
        code = 0
    assert_done(given, code, printed, error)
    if given[0] == "diagnose":
        many = ("fleet/arm-3", "fleet/arm-4")
        for made in many if "--out" in given else (f"{given[1]}-diagnosis",):
            answer = json.loads(Path(made, "diagnosis.json").read_text(encoding="utf-8"))
            assert [effect["name"] for effect in answer["effects"]] == ["cable-torsion"]


def assert_done(given: list[str], code: int, printed: str, error: str) -> None:
    """A command ended well, printed its answer, and wrote what it was asked to write."""
    # Without a terminal, lines with the time in brackets show progress.
    assert (code, [text for text in error.splitlines() if not text.startswith("[")]) == (0, []), error
    assert printed
    for option in ("--rrd", "--out", "--report", "--json"):
        if option in given:
            assert Path(given[given.index(option) + 1]).exists()


@contextlib.contextmanager
def _cluster():
    """The address of a scheduler with two workers on the loopback interface."""
    distributed = pytest.importorskip("distributed", reason="needs Dask: pip install -e '.[fleet]'")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


# Files


def test_the_campaign_of_the_readme_is_read_with_its_own_rig(tmp_path):
    """Its recordings are simulated with the parameters that it gives."""
    (text,) = blocks(README, "toml")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    given = tomllib.loads(text)
    time = np.arange(0.0, 1.0, 5e-3)
    rig = package.rig().replace(**given["parameters"])
    runs = [package.model(rig).simulate(time, np.where(time < 0.4, size, -0.1)) for size in (0.2, 0.3)]
    for entry, run in zip(given["recordings"], runs, strict=True):
        columns = (time, run["torque_command"], np.degrees(run["hub_angle"]), 1e6 * run["strain_base"])
        header = "time,torque_command,hub_angle,gauge1"
        np.savetxt(
            tmp_path / entry["file"], np.column_stack(columns), delimiter=",", header=header, comments=""
        )
    campaign = package.read_campaign(tmp_path)
    assert {name: campaign.rig[name] for name in given["parameters"]} == given["parameters"]
    np.testing.assert_allclose(campaign.fit[0]["hub_angle"], runs[0]["hub_angle"], rtol=1e-9, atol=1e-12)


@pytest.mark.usefixtures("laboratory")
def test_the_files_of_the_documents_are_read():
    assert package.read_rig(Path("my-rig.toml")).effects == {"viscous-friction": {"viscous": 0.069}}
    assert read_requirements(Path("limits.toml")).share == 0.99


def test_the_drive_of_the_documents_is_read():
    (block,) = blocks(DOCUMENTS["docs/your-rig.md"], "toml")
    drive = DriveEntry.model_validate(tomllib.loads(block)["drive"])
    assert torque_per_command(drive) == pytest.approx(0.65 * 70 * 0.0077 / 2.6)


def test_every_toml_block_is_read_by_one_of_these():
    """That of docs/recordings.md is read in `test_readme`."""
    having = {name for name, text in DOCUMENTS.items() if blocks(text, "toml")}
    assert having == {
        "README.md",
        "docs/identification.md",
        "docs/recordings.md",
        "docs/validation.md",
        "docs/your-rig.md",
    }


# Python


@pytest.mark.slow
def test_script_notebook_and_snippet_of_a_diagnosis_run(tmp_path, monkeypatch):
    """One diagnosis for all three, and for the sentence of the README."""
    monkeypatch.chdir(tmp_path)
    diagnosis = _example("diagnose").main(str(DEMO), "script")
    assert diagnosis.verdict == "explained"
    assert [row["turned_down_by"] for row in diagnosis.ranking().rows()][0] is None
    assert {p.name for p in Path("script").iterdir()} >= {"report.html", "run.rrd", "diagnosis.json"}
    _check_headline(fill_readme.sentence(diagnosis.to_json()))

    asked, pictures = [], []
    monkeypatch.setattr(package, "diagnose", lambda campaign: asked.append(str(campaign)) or diagnosis)
    names = _run_notebook("diagnosis")
    assert "cable-torsion" in names["diagnosis"]._repr_html_()

    monkeypatch.setattr(go.Figure, "show", lambda figure: pictures.append(figure))
    (snippet,) = blocks(README, "python")
    exec(snippet, {})
    assert asked[1:] == ["my-rig"]
    assert len(pictures) == 1
    assert Path("results", "report.html").exists()


def _check_headline(found: str) -> None:
    """The README's sentence is this one, its numbers to a tenth: another processor rounds otherwise."""
    said = fill_readme.part(README, "headline")
    numbers = [[float(n) for n in re.findall(r"\*\*([\d.]+)°", text)] for text in (said, found)]
    assert numbers[0] == pytest.approx(numbers[1], rel=0.1)
    assert re.sub(r"[\d.]+°", "", said) == re.sub(r"[\d.]+°", "", found)


@pytest.mark.slow
def test_the_notebook_of_a_controller_runs(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    names = _run_notebook("controller")
    ends = {law: run.metrics["hub_final_deg"] for law, run in names["runs"].items()}
    pulled = {law: run.metrics["hub_final_deg"] for law, run in names["pulled"].items()}
    # The text: "some nine degrees short".
    assert [round(ends[law] - pulled[law]) for law in ("mine", "the paper's")] == [9, 10]
    assert (tmp_path / "run.rrd").exists()


@pytest.mark.slow
def test_the_notebook_of_the_models_runs():
    names = _run_notebook("models")
    metrics = {plant: run.metrics for plant, run in names["runs"].items()}
    # The text: the paper's 18 mm, half of the time at rest instead of a sixth.
    assert metrics["paper"]["peak_deflection_mm"] == pytest.approx(18, abs=0.3)
    assert metrics["chain"]["stuck_fraction"] == pytest.approx(1 / 2, abs=0.02)
    assert metrics["paper"]["stuck_fraction"] == pytest.approx(1 / 6, abs=0.02)
    assert names["apart"]["modal"] < 1 < names["apart"]["paper"]


@pytest.mark.slow
def test_blocks_of_the_documents_run(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(DEMO, "try")
    for name in ("docs/adding-an-effect.md", "docs/control.md", "docs/index.md"):
        for block in blocks(DOCUMENTS[name], "python"):
            try:
                exec(block, {})
            finally:
                REGISTRY.pop("eddy-brake", None)


def test_the_effect_of_the_documents_is_that_of_the_example():
    (block,) = blocks(DOCUMENTS["docs/adding-an-effect.md"], "python")
    definition = block[block.index("@HubLaw") : block.index("\n\n\nregister(")]
    assert definition in (EXAMPLES / "own_effect.py").read_text(encoding="utf-8")


def test_the_fleet_of_the_documents_runs(tmp_path, monkeypatch):
    """With a task in the place of a diagnosis, in a thread."""
    (tmp_path / "RIGS" / "a").mkdir(parents=True)
    campaign_folder.write(tmp_path / "RIGS" / "a")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fleet_run.diagnose_fleet, "__defaults__", (fleet_tasks.solved,))
    monkeypatch.setattr("twin.executors.processes.processes", ThreadPoolExecutor)
    (block,) = blocks(DOCUMENTS["docs/fleets.md"], "python")
    names = {}
    exec(block, names)
    assert names["fleet"].effects == {"cable-torsion": ("small",)}


def test_every_python_block_is_run_by_one_of_these():
    having = {name for name, text in DOCUMENTS.items() if blocks(text, "python")}
    assert having == {
        "README.md",
        "docs/adding-an-effect.md",
        "docs/control.md",
        "docs/fleets.md",
        "docs/index.md",
    }
    assert {p.stem for p in EXAMPLES.glob("*.ipynb")} == {"diagnosis", "controller", "models"}


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_kept_with_small_outputs_which_the_site_shows(path):
    assert path.stat().st_size < 200_000
    page = build.staged(f"examples/{path.stem}", pages.notebook_page(path), path.parent, set())
    assert 1 <= page.count("](data:image/png;base64,") <= 2
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    outputs = [output["data"] for cell in cells for output in cell.get("outputs", ())]
    assert len(outputs) >= 4
    for data in outputs:
        returned = "".join(data.get("text/html") or data.get("text/plain") or ())
        assert returned.replace("<table>", '<table class="table">') in page


def test_a_notebook_is_executed_with_what_its_cells_return():
    pytest.importorskip("matplotlib", reason="draws the pictures: pip install -e '.[docs]'")
    import run_notebooks

    figure = "import plotly.graph_objects as go\nfigure = go.Figure()\nfigure.add_scatter(x=[0, 1], y=[x, 3])\nfigure"
    sources = ("x = 2", "x + 1", "x;", figure)
    notebook = {"cells": [{"cell_type": "code", "source": [source]} for source in sources]}
    outputs = [cell["outputs"] for cell in run_notebooks.executed(notebook)["cells"]]
    assert [len(output) for output in outputs] == [0, 1, 0, 1]
    assert outputs[1][0]["data"] == {"text/plain": ["3"]}
    assert base64.b64decode(outputs[3][0]["data"]["image/png"]).startswith(b"\x89PNG")


# The site


@pytest.mark.parametrize("name", REGISTRY)
def test_every_effect_has_its_page(name):
    effect = REGISTRY[name]
    assert effect.seen_as
    assert effect.source
    assert (ROOT / "docs" / "pictures" / "effects" / f"{name}.svg").exists(), (
        "python docs/tools/draw_effects.py"
    )
    assert effect.mistaken_for.keys() <= REGISTRY.keys() - {name}
    page = pages.effect_page(effect, PLANTED[name])
    for heading in (
        "Law",
        "Parameters",
        "How it looks in recordings",
        "What it is mistaken for",
        "To try it",
    ):
        assert f"\n## {heading}\n" in page
    assert all(f"`{p.name}`" in page for p in effect.parameters)
    tables = "\n".join(line for line in page.splitlines() if not line.startswith("twin "))
    assert not re.search(r"\de[+-]?\d|\binf\b|\bN m\b", tables)
    (block,) = blocks(page, "sh")
    for line in block.splitlines():
        assert_accepted(line)


def test_what_is_mistaken_for_another_is_on_both_pages():
    for name, effect in REGISTRY.items():
        for other in effect.mistaken_for:
            assert f"[`{name}`]" in pages.effect_page(REGISTRY[other], PLANTED[other])


def test_every_effect_is_mistaken_for_some_other_one():
    named = {other for effect in REGISTRY.values() for other in effect.mistaken_for}
    assert {
        name for name, effect in REGISTRY.items() if not effect.mistaken_for and name not in named
    } == set()


def test_every_command_is_on_its_page():
    page = pages.commands_page()
    for name, command in COMMANDS.items():
        assert f"\n## twin {name}\n" in page
        assert all(
            f"{o}" in page for p in command.params for o in p.opts if o.startswith("--") and not p.hidden
        )


def test_every_page_is_in_the_table_of_contents():
    below = {page for children in build.CONTENTS.values() for page in children}
    listed = {name for name in build.sources() if not name.startswith("benchmarks/results/")}
    assert listed == below | {"index"}


def test_links_lead_to_the_site_or_to_the_repository():
    known = {"diagnosis", "benchmarks/results/diagnosis", "effects/cogging"}
    text = "[a](diagnosis.md#method) [b](../benchmarks/results/diagnosis.md) [c](../twin/cli.py) [d](https://x.org)"
    turned = build.staged("paper", text, ROOT / "docs", known).splitlines()[0]
    assert turned == (
        "[a](diagnosis.md#method) [b](benchmarks/results/diagnosis.md) "
        "[c](https://github.com/flexlink-twin/flexlink-twin/blob/main/twin/cli.py) [d](https://x.org)"
    )


def test_the_readme_counts_the_effects_right():
    counts = [int(n) for n in re.findall(r"(\d+) effects", README)]
    assert set(counts) == {len(REGISTRY)}


def test_pictures_of_the_readme_are_there():
    targets = re.findall(r'(?:src|srcset)="([^"]+)"', README)
    assert targets
    for target in targets:
        assert (ROOT / target.partition("/main/")[2]).is_file(), target


def test_reliability_of_the_readme_is_that_of_the_answers_and_adds_up():
    table = fill_readme.part(README, "reliability")
    assert table == fill_readme.reliability(), "python benchmarks/fill_readme.py reliability"
    assert fill_readme.part(README, "intervals") == fill_readme.intervals(), (
        "python benchmarks/fill_readme.py intervals"
    )
    rows = [line.split("|")[2:-1] for line in table.splitlines()[2:]]
    # Kind x engine x (right, all).
    counts = np.array([[_right_of(cell.strip()) for cell in row] for row in rows])
    assert np.array_equal(counts[:-1].sum(axis=0), counts[-1])
    right, total = counts.sum(axis=1).T
    assert f"On {total[-1]} campaigns" in README
    nothing = [*fill_readme.KINDS].index("nothing")
    wrong = ["none", "one", "two"][total[nothing] - right[nothing]]
    assert f"Of the {total[nothing]} rigs with nothing missing, {wrong} got a false alarm" in README


def _right_of(cell: str) -> tuple[int, int]:
    right, _, total = cell.partition(" of ")
    return int(right or 0), int(total or 0)


def _rig_file() -> str:
    """A file of the rig of the examples."""
    finite = {name: value for name, value in package.rig().items() if math.isfinite(value)}
    uncertain = {"bending_stiffness": 0.03, "hub_inertia": 0.05}
    lines = [
        f"{name} = {{ value = {value!r}, standard_error = {uncertain[name] * value!r} }}"
        if name in uncertain
        else f"{name} = {value!r}"
        for name, value in finite.items()
    ]
    return "\n".join(['format = 1\nname = "my-rig"\n\n[parameters]', *lines, "", ""])


def _run_notebook(name: str) -> dict:
    """The variables that the code cells of a notebook of the examples leave."""
    notebook = json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))
    names: dict = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    return names


def _example(name: str):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
