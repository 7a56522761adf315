"""What the documents promise: commands, files, formats and tables are those of the program."""

import re
import shlex
import tomllib

import fill_readme
import pytest
import typer.main
from paths import ROOT

from twin.campaigns import schema
from twin.campaigns.units import DERIVED_UNITS, TIME, allowed
from twin.cli import app
from twin.parameters import DEFAULTS, PARAMETERS
from twin.recording import CHANNEL_UNITS

README = (ROOT / "README.md").read_text(encoding="utf-8")
FORMAT = (ROOT / "docs" / "recordings.md").read_text(encoding="utf-8")
PATHS = [ROOT / "README.md", *ROOT.glob("[a-z]*/README.md"), *ROOT.glob("docs/*.md")]
DOCUMENTS = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in sorted(PATHS)}
OWN = (
    "https://github.com/flexlink-twin/flexlink-twin/",
    "https://raw.githubusercontent.com/flexlink-twin/flexlink-twin/",
)
COMMANDS = typer.main.get_command(app).commands


def blocks(text: str, language: str) -> list[str]:
    """Returns the code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def shown(text: str) -> list[str]:
    """Returns the command lines that a document shows: in shell blocks, after prompts, in tables."""
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    lines += re.findall(r"^\$ (.*)", text, re.MULTILINE)
    return lines + re.findall(r"^\| `(twin [^`]*|make [^`]*)`", text, re.MULTILINE)


def rows(text: str, header: str) -> list[list[str]]:
    """Returns the cells of the table whose first column is called `header`."""
    table = re.search(rf"^\| {header} \|.*\n\|[-| :]+\n((?:\|.*\n)+)", text, re.MULTILINE).group(1)
    return [[cell.strip().strip("`") for cell in line.strip("|").split(" | ")] for line in table.splitlines()]


def test_first_command_comes_early():
    assert README[: README.index("```sh")].count("\n") < 30


@pytest.mark.parametrize("name", DOCUMENTS)
def test_commands_exist_with_their_options(name):
    twin = [shlex.split(line) for line in shown(DOCUMENTS[name]) if line.startswith("twin ")]
    assert {words[1] for words in twin} <= COMMANDS.keys()
    for words in twin:
        options = {o for p in COMMANDS[words[1]].params for o in p.opts}
        assert set(re.findall(r"--[a-z][a-z-]*", " ".join(words))) <= options


def test_every_command_is_in_the_table():
    assert {
        row[0].split()[1] for row in rows(README, "command") if row[0].startswith("twin")
    } == COMMANDS.keys()


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([\w-]+):", makefile, re.MULTILINE))
    assert {line.split()[1] for line in shown(README) if line.startswith("make ")} <= targets
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "make docs" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "make test" in blocks(README, "sh")[-1]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_links_lead_somewhere(name):
    for target in re.findall(r"\]\(([^)#]+)\)", DOCUMENTS[name]):
        if target.startswith(OWN):
            # A package index shows the README too: its links are absolute.
            assert (ROOT / target.partition("/main/")[2]).exists(), target
        elif not target.startswith("http"):
            assert ((ROOT / name).parent / target).exists(), target


def test_readme_has_no_link_that_only_works_in_the_repository():
    assert [t for t in re.findall(r"\]\(([^)#]+)\)", README) if not t.startswith("http")] == []


def test_effects_are_those_of_the_registry():
    hint = "python benchmarks/fill_readme.py effects"
    assert fill_readme.part(DOCUMENTS["docs/effects.md"], "effects") == fill_readme.effects(), hint


def test_demo_shown_has_an_answer_and_the_files():
    from twin.report.deliver import FILES

    printed = fill_readme.part(README, "demo")
    assert "$ twin demo\ndemo-rig: explained\n" in printed
    for what, name in FILES.items():
        assert (f"demo-rig-diagnosis/{name}" in printed) is (what != "patch"), name


@pytest.mark.parametrize("text", [README, FORMAT], ids=["README", "format"])
def test_campaign_files_shown_are_valid(text):
    for block in blocks(text, "toml"):
        said = schema.parse(tomllib.loads(block))
        assert {entry.role for entry in said.recordings} == {"fit", "holdout"}


def test_format_lists_every_channel_with_its_unit():
    assert {row[0]: row[1] for row in rows(FORMAT, "channel")} == CHANNEL_UNITS | DERIVED_UNITS


def test_format_lists_every_parameter_with_unit_and_default():
    listed = {row[0]: row[1:] for row in rows(FORMAT, "parameter")}
    assert {name: row[0] for name, row in listed.items()} == {n: unit for n, (unit, _) in PARAMETERS.items()}
    defaults = {n: row[2] for n, row in listed.items() if row[2] not in ("required", "none")}
    assert {n: float(v) for n, v in defaults.items()} == {
        n: v for n, v in DEFAULTS.items() if v != float("inf")
    }
    assert {n for n, row in listed.items() if row[2] == "required"} == PARAMETERS.keys() - DEFAULTS.keys()


def test_format_names_every_key_and_unit():
    tables = (schema.Channel, schema.RecordingEntry, schema.CampaignFile, schema.DriveEntry)
    for key in (key for table in tables for key in table.model_fields):
        # The constants of the drive have an uncertainty each.
        assert re.search(rf"\b{key.removesuffix('_uncertainty')}", FORMAT), key
    for unit in {unit for channel in (TIME, *CHANNEL_UNITS) for unit in allowed(channel)}:
        assert f"`{unit}`" in FORMAT or f'"{unit}"' in FORMAT or f"| {unit} |" in FORMAT, unit


def test_versions_agree():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert version in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
