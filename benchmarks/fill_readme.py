"""Writes the generated parts of README.md: the output of `twin demo`, and tables.

    python benchmarks/fill_readme.py [demo] [effects] [accuracy] [screening] [adoption] [revision] [explanation]

Without names, all of them. Each part stands between <!-- NAME --> and <!-- end -->, the first three in README.md, the
rules in docs/diagnosis.md.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from twin.diagnosis import judgement, rules
from twin.effects import catalogue

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
DIAGNOSIS = ROOT / "docs" / "diagnosis.md"


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


def screening() -> str:
    """The rule by which a candidate is fitted, as a table."""
    return judgement.markdown(rules.SCREENING)


def adoption() -> str:
    """The rules by which a candidate is added to the model, as a table."""
    return judgement.markdown(rules.ADOPTION)


def revision() -> str:
    """The rules by which an adopted effect stays, as a table."""
    return judgement.markdown(rules.REVISION)


def explanation() -> str:
    """The rules by which a channel is explained, as a table."""
    return judgement.markdown(rules.EXPLANATION)


PARTS: Mapping[str, tuple[Path, Callable[[], str]]] = {
    "demo": (README, demo),
    "effects": (README, effects),
    "accuracy": (README, accuracy),
    "screening": (DIAGNOSIS, screening),
    "adoption": (DIAGNOSIS, adoption),
    "revision": (DIAGNOSIS, revision),
    "explanation": (DIAGNOSIS, explanation),
}
"""Part -> its document, and the function that generates it."""


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
        path, generate = PARTS[name]
        text = path.read_text(encoding="utf-8")
        path.write_text(replaced(text, name, generate()), encoding="utf-8")


if __name__ == "__main__":
    main()
