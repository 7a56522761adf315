"""Writes the generated parts of README.md: the output of `twin demo`, and tables.

    python benchmarks/fill_readme.py [demo] [effects] [accuracy]

Each part stands between <!-- NAME --> and <!-- end -->.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from twin.effects import catalogue

README = Path(__file__).resolve().parent.parent / "README.md"


def demo() -> str:
    """Returns the output of the demo as a code block."""
    with tempfile.TemporaryDirectory() as folder:
        twin = [sys.executable, "-m", "twin.cli", "demo"]
        printed = subprocess.run(twin, cwd=folder, check=True, capture_output=True, text=True).stdout
    lines = "\n".join(line.rstrip() for line in printed.splitlines())
    return f"```console\n$ twin demo\n{lines}\n```"


def effects() -> str:
    """Returns the library of effects as a table."""
    return catalogue.markdown()


def accuracy() -> str:
    """Returns frequencies and damping ratios of the chain beside the exact ones, as a table."""
    from twin.mechanics.accuracy import check, text_rows
    from twin.rigs import preset

    head = ("mode", "exact [Hz]", "chain", "simulated", "damping ratio", "chain", "simulated")
    rows = [row[: len(head)] for row in text_rows(check(preset("bossi2009")))]
    rule = ("---", *["---:"] * (len(head) - 1))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows))


PARTS: Mapping[str, Callable[[], str]] = {"demo": demo, "effects": effects, "accuracy": accuracy}


def part(text: str, name: str) -> str:
    """Returns the content of a part of the README."""
    return re.search(_place(name), text, re.DOTALL).group(2)


def replaced(text: str, name: str, content: str) -> str:
    """Returns the README with new content in one part."""
    return re.sub(_place(name), lambda found: f"{found[1]}{content}{found[3]}", text, flags=re.DOTALL)


def _place(name: str) -> str:
    return rf"(<!-- {name} -->\n)(.*?)(\n<!-- end -->)"


def main() -> None:
    """Writes the parts named on the command line, by default all."""
    for name in sys.argv[1:] or PARTS:
        text = README.read_text(encoding="utf-8")
        README.write_text(replaced(text, name, PARTS[name]()), encoding="utf-8")


if __name__ == "__main__":
    main()
