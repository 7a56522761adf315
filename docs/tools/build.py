"""Builds the documentation site into build/site; any warning is an error.

python docs/tools/build.py      (or `make docs`)

The pages of docs/ and those that are made from the source go into build/pages with a table of contents, their links
turned to the site or, where it does not have the file, to the repository. Sphinx does the rest.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import pages

from twin.effects import REGISTRY

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests"))
from planted import PLANTED  # noqa: E402  sizes of effects that a rig may well have

DOCS = ROOT / "docs"
STAGED = ROOT / "build" / "pages"
SITE = ROOT / "build" / "site"

CONTENTS: Mapping[str, tuple[str, ...]] = {
    "index": (
        "your-rig",
        "method",
        "effects",
        "control",
        "examples",
        "paper",
        "real-rigs",
        "limits",
        "reference",
    ),
    "your-rig": ("recordings", "diagnosis", "fleets", "identification", "files-out", "commands"),
    "method": ("accuracy", "structural-effects"),
    "effects": ("adding-an-effect", *(f"effects/{name}" for name in REGISTRY)),
    "control": ("validation", "scenarios", "mjcf"),
    "examples": ("examples/diagnosis", "examples/controller", "examples/models"),
    "paper": ("table3",),
    "limits": ("promises", "benchmarks/README"),
}
"""Page -> pages below it."""
SHORT: Mapping[str, str] = {
    "your-rig": "Your rig",
    "method": "Method",
    "effects": "Effects",
    "paper": "The paper",
    "limits": "Limits",
    "reference": "Python",
}
"""Page -> its name in the table of contents, where that is not its title."""


def sources() -> dict[str, tuple[str, Path]]:
    """Page of the site -> its text, and the folder that its links are relative to."""
    found = {path.stem: (path.read_text(encoding="utf-8"), DOCS) for path in sorted(DOCS.glob("*.md"))}
    for path in [ROOT / "benchmarks" / "README.md", *sorted((ROOT / "benchmarks" / "results").glob("*.md"))]:
        name = path.relative_to(ROOT).with_suffix("").as_posix()
        text = path.read_text(encoding="utf-8")
        title = "" if text.startswith("# ") else f"# {path.stem.capitalize()}\n\n"
        found[name] = (title + text, path.parent)
    for name, effect in REGISTRY.items():
        found[f"effects/{name}"] = (pages.effect_page(effect, PLANTED[name]), DOCS)
    for path in sorted((DOCS / "examples").glob("*.ipynb")):
        found[f"examples/{path.stem}"] = (pages.notebook_page(path), path.parent)
    found["commands"] = (pages.commands_page(), DOCS)
    return found


def staged(name: str, text: str, folder: Path, known: set[str]) -> str:
    """A page as Sphinx reads it: links, pictures of two themes, and the pages below it."""
    if name == "effects":
        text = re.sub(r"^\| `([a-z-]+)` \|", r"| [`\1`](effects/\1.md) |", text, flags=re.MULTILINE)
    up = "../" * name.count("/")
    text = re.sub(
        r"(!?)\[([^\]]*)\]\((?!https?:|data:|#)([^)#\s]+)(#[^)]*)?\)",
        lambda m: _link(m, folder, up, known),
        text,
    )
    text = re.sub(r"\(([^()]+)#gh-(light|dark)-mode-only\)", r"(\1){.only-\2}", text)
    below = list(CONTENTS.get(name, ()))
    if name == "benchmarks/README":
        below = sorted(
            page.removeprefix("benchmarks/") for page in known if page.startswith("benchmarks/results/")
        )
    entries = [f"{SHORT[page]} <{page}>" if page in SHORT else page for page in below]
    contents = "\n".join(["", "```{toctree}", ":hidden:", ":maxdepth: 2", "", *entries, "```", ""])
    return text + contents if below else text


def _link(found: re.Match[str], folder: Path, up: str, known: set[str]) -> str:
    """The same link from the staged page: to a page of the site, a picture, or a file of the repository."""
    image, label, target, anchor = found[1], found[2], found[3], found[4] or ""
    path = (folder / target).resolve()
    if not path.exists():
        return found[0]
    place = path.relative_to(ROOT).as_posix()
    served = re.sub(r"\.(md|ipynb)$", "", place.removeprefix("docs/"))
    if served in known:
        return f"[{label}]({up}{served}.md{anchor})"
    if image:
        return f"![{label}]({up}{served}{anchor})"
    return f"[{label}]({pages.REPOSITORY}{place}{anchor})"


def main() -> int:
    """Writes the staged pages and runs Sphinx on them."""
    from sphinx.cmd.build import build_main  # an extra of its own: the tests do without

    shutil.rmtree(STAGED, ignore_errors=True)
    found = sources()
    for name, (text, folder) in found.items():
        path = STAGED / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(staged(name, text, folder, set(found)), encoding="utf-8")
    shutil.copytree(DOCS / "pictures", STAGED / "pictures")
    quiet_and_strict = ["-q", "-W", "--keep-going", "-E"]
    return build_main(
        [*quiet_and_strict, "-b", "html", "-c", str(Path(__file__).parent), str(STAGED), str(SITE)]
    )


if __name__ == "__main__":
    sys.exit(main())
