"""Writes the parts of README.md that come out of the program: what `twin demo` prints, tables.

    python benchmarks/fill_readme.py [demo] [effects] [accuracy]

Each part stands between <!-- NAME --> and <!-- end -->.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from twin.effects import REGISTRY, Effect
from twin.labels import unit

README = Path(__file__).resolve().parent.parent / "README.md"


def demo() -> str:
    """What the demo prints, as a code block."""
    with tempfile.TemporaryDirectory() as folder:
        twin = [sys.executable, "-m", "twin.cli", "demo"]
        printed = subprocess.run(twin, cwd=folder, check=True, capture_output=True, text=True).stdout
    lines = "\n".join(line.rstrip() for line in printed.splitlines())
    return f"```console\n$ twin demo\n{lines}\n```"


def effects() -> str:
    """The registry as a table."""
    return "\n".join(
        ["| effect | what the model lacks | law | parameters |", "| --- | --- | --- | --- |", *effect_rows()]
    )


def effect_rows() -> Iterator[str]:
    """One line for each effect: name, plain words, first line of its docstring, parameters."""
    for name, effect in REGISTRY.items():
        parameters = ", ".join(f"`{p.name}` {unit(p.unit)}".rstrip() for p in effect.parameters)
        yield f"| `{name}` | {effect.meaning} | {_law(effect)} | {parameters} |"


def _law(effect: Effect) -> str:
    first = (type(effect).__doc__ or "").split("\n\n")[0]
    return " ".join(first.split()).rstrip(".").replace("|", r"\|").replace("*", r"\*")


def accuracy() -> str:
    """Frequencies and damping ratios of the chain beside the exact ones."""
    from twin.mechanics.accuracy import check, text_rows
    from twin.rigs import preset

    head = ("mode", "exact [Hz]", "chain", "simulated", "damping ratio", "chain", "simulated")
    rows = [row[: len(head)] for row in text_rows(check(preset("bossi2009")))]
    rule = ("---", *["---:"] * (len(head) - 1))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


PARTS: Mapping[str, Callable[[], str]] = {"demo": demo, "effects": effects, "accuracy": accuracy}


def part(text: str, name: str) -> str:
    """Returns what stands in a part of the README."""
    return re.search(_place(name), text, re.DOTALL).group(2)


def replaced(text: str, name: str, content: str) -> str:
    """Returns the README with another content of one part."""
    return re.sub(_place(name), lambda found: f"{found[1]}{content}{found[3]}", text, flags=re.DOTALL)


def _place(name: str) -> str:
    return rf"(<!-- {name} -->\n)(.*?)(\n<!-- end -->)"


def main() -> None:
    """Fills the parts named on the command line, by default all."""
    for name in sys.argv[1:] or PARTS:
        text = README.read_text(encoding="utf-8")
        README.write_text(replaced(text, name, PARTS[name]()), encoding="utf-8")


if __name__ == "__main__":
    main()
