"""Hook of mkdocs: pages that are made from the source, and links into the repository.

- a page for each effect, from its class;
- the notebooks of the examples;
- the commands with their options, from the command line's own parser;
- benchmarks/README.md and its results, which lie outside of docs/.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import typer.main
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from twin.cli import app
from twin.effects import REGISTRY, Effect, catalogue
from twin.labels import unit

ROOT = Path(__file__).resolve().parent.parent.parent
REPOSITORY = "https://github.com/flexlink-twin/flexlink-twin/blob/main/"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Adds the effects to the table of contents."""
    section = next(entry["Effects"] for entry in config.nav or [] if "Effects" in entry)
    section += [f"effects/{name}.md" for name in REGISTRY]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made from the source."""
    pages = {f"effects/{name}.md": effect_page(effect) for name, effect in REGISTRY.items()}
    pages["commands.md"] = commands_page()
    pages["benchmarks/README.md"] = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    for path in sorted((ROOT / "benchmarks" / "results").glob("*.md")):
        pages[f"benchmarks/results/{path.name}"] = path.read_text(encoding="utf-8")
    for path in sorted((ROOT / "docs" / "examples").glob("*.ipynb")):
        pages[f"examples/{path.stem}.md"] = notebook_page(path)
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links of a page that lead out of docs/ lead to the same file of the site, or of the repository."""
    if page.file.src_uri == "effects.md":
        markdown = re.sub(r"^\| `([a-z-]+)` \|", r"| [`\1`](effects/\1.md) |", markdown, flags=re.MULTILINE)
    folder = _folder(page.file.src_uri)

    def moved(found: re.Match[str]) -> str:
        target, anchor = found[1], found[2] or ""
        path = (folder / target).resolve()
        if not path.exists() or not path.is_relative_to(ROOT):
            return found[0]
        place = path.relative_to(ROOT).as_posix()
        served = re.sub(r"\.ipynb$", ".md", place.removeprefix("docs/"))
        if files.get_file_from_path(served) is None:
            return f"]({REPOSITORY}{place}{anchor})"
        up = "../" * page.file.src_uri.count("/")
        return f"]({up}{served}{anchor})"

    return re.sub(r"\]\((?!https?:|#)([^)#\s]+)(#[^)]*)?\)", moved, markdown)


def _folder(src_uri: str) -> Path:
    """The folder in the repository that links of a page are relative to."""
    return (ROOT if src_uri.startswith("benchmarks/") else ROOT / "docs") / Path(src_uri).parent


def notebook_page(path: Path) -> str:
    """The cells of a notebook, which is kept without outputs."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    code = [f"```python\n{t}\n```" if c["cell_type"] == "code" else t for c, t in zip(cells, texts, strict=True)]
    return "\n\n".join([*code, f"[The notebook]({REPOSITORY}docs/examples/{path.name})"]) + "\n"


def effect_page(effect: Effect) -> str:
    """The page of an effect, from its class."""
    rows = [
        f"| `{p.name}` | {unit(p.unit) or '1'} | {_neutral(p.neutral)} | {p.bounds[0]:g} to {p.bounds[1]:g} |"
        for p in effect.parameters
    ]
    alike = effect.mistaken_for | {
        name: other.mistaken_for[effect.name]
        for name, other in REGISTRY.items()
        if effect.name in other.mistaken_for
    }
    confused = [f"| [`{name}`]({name}.md) | {what} |" for name, what in alike.items()]
    more = (type(effect).__doc__ or "").partition("\n\n")[2]
    parts = [
        f"# {effect.name.replace('-', ' ').capitalize()}",
        f"`{effect.name}`: {effect.meaning}. Acts on: {effect.acts_on}.",
        f"## Law\n\n{catalogue.law(effect)}.",
        re.sub(r"\s*\n\s*", " ", more).strip().replace("*", r"\*"),
        f"Source: {effect.source}." if effect.source else "",
        "## Parameters",
        "\n".join(["| parameter | unit | neutral | range of a search |", "| --- | --- | --- | --- |", *rows]),
        f"## How it looks in recordings\n\n{effect.seen_as}",
        "## What it is mistaken for",
        "\n".join(["| effect | what tells the two apart |", "| --- | --- |", *confused]) if confused else "Nothing known.",
        f"## To try it\n\n```sh\n{_trial(effect)}\ntwin diagnose try\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _neutral(value: float | None) -> str:
    return "as declared" if value is None else f"{value:g}"


def _trial(effect: Effect) -> str:
    """A command that makes recordings of a virtual rig with the effect."""
    return f"python -m twin.virtual_rig try --effect {effect.name}:{effect.parameters[0].name}=VALUE"


def commands_page() -> str:
    """Every command with its arguments and options, from the parser of the command line."""
    group = typer.main.get_command(app)  # a click Group, of typer's own copy of click
    parts = ["# Commands", "From the command line's own parser: what `twin COMMAND --help` prints."]
    for name, command in group.commands.items():
        usage = " ".join([f"twin {name}", *(_usage(p) for p in command.params if p.param_type_name == "argument")])
        parts += [f"## twin {name}", f"```\n{usage}\n```", _escaped(command.help or "")]
        options = [p for p in command.params if p.param_type_name == "option" and not p.hidden]
        rows = [f"| `{', '.join(p.opts)}` | {_escaped(p.help or '')} | {_default(p)} |" for p in options]
        if rows:
            parts.append("\n".join(["| option | meaning | default |", "| --- | --- | --- |", *rows]))
    return "\n\n".join(parts) + "\n"


def _usage(argument: Any) -> str:
    name = (argument.metavar or argument.name or "").strip("[]").upper()
    return name if argument.required else f"[{name}]"


def _default(option: Any) -> str:
    value = option.default
    return "" if value is None or callable(value) or value is False or value == () else f"`{value}`"


def _escaped(text: str) -> str:
    return re.sub(r"\s*\n\s*", " ", text).replace("|", r"\|").replace("*", r"\*").replace("<", "&lt;")
