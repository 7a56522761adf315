"""Is an answer the same on a second run: other folder, other threads? `python benchmarks/determinism.py CAMPAIGN`.

Diagnoses the campaign twice, the second time as a copy in another folder, with one thread of the numerical libraries
instead of their own choice and on one processor where the system can be told so, and compares the files that are
written. Times differ, the date and the command line in the provenance, and the identities that rerun gives its rows.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from machine import describe

COMPARED = ("diagnosis.json", "augmented-rig.toml", "augmented.xml")
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def diagnosed(campaign: Path, out: Path, prefix: list[str], environment: dict[str, str]) -> Path:
    """Diagnoses a campaign in a process of its own; returns the folder of the results."""
    command = [*prefix, sys.executable, "-m", "twin.cli", "diagnose", str(campaign), "--out", str(out)]
    subprocess.run(command, check=True, env={**os.environ, **environment}, stdout=subprocess.DEVNULL)
    return out


def content(file: Path) -> str:
    """The content of a result without times and command; of JSON, with one key a line."""
    text = file.read_text(encoding="utf-8")
    if file.suffix != ".json":
        return text
    answer = json.loads(text)
    answer.pop("wall_s")
    for name in ("date", "command"):
        answer["provenance"].pop(name)
    return json.dumps(answer, indent=1)


def main() -> None:
    """Compares the two runs and prints a table; exits with 1 if a file differs."""
    campaign = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "elsewhere" / campaign.name
        shutil.copytree(campaign, copy)
        alone = ["taskset", "-c", "0"] if shutil.which("taskset") else []
        first = diagnosed(campaign, Path(folder) / "first", [], {})
        second = diagnosed(copy, Path(folder) / "second", alone, _ONE_THREAD)
        same = {name: content(first / name) == content(second / name) for name in COMPARED}
    print(f"`python benchmarks/determinism.py {sys.argv[1]}`, {describe()}\n")
    print("| file | second run, other folder, one thread |\n| --- | --- |")
    for name, equal in same.items():
        print(f"| `{name}` | {'identical but for time, date and command' if equal else 'DIFFERS'} |")
    sys.exit(0 if all(same.values()) else 1)


if __name__ == "__main__":
    main()
