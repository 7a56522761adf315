"""How the time and memory of a diagnosis grow with the recordings.

    python benchmarks/growth.py [--most 10] [--workers 2] [--work FOLDER]

Campaigns of the virtual rig with undeclared viscous friction, a minute of multisines at 1 kHz in five recordings, one
of them held out: longer recordings, more of them, other sample rates, fewer candidates. Each is diagnosed in a process
of its own. The table is printed, and written to benchmarks/results/growth.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from machine import command, describe

from twin.effects import REGISTRY, unregister
from twin.virtual_rig.campaign_writer import make_campaign
from twin.virtual_rig.experiments import Experiment, multisine
from twin.virtual_rig.rig import Rig
from twin.virtual_rig.sensors import Sensors

RESULTS = Path(__file__).parent / "results" / "growth.md"
EFFECT = {"viscous-friction": {"viscous": 2e-3}}
SEED = 7
RECORDINGS = 5  # of 12 s each
RATE = 1000.0  # Hz


@dataclass(frozen=True)
class Case:
    """What is changed of the first campaign.

    Attributes:
      what: what grows.
      factor: by how much.
      length: factor on the length of each recording.
      number: factor on the number of recordings.
      rate: sample rate [Hz].
      candidates: effects in the library.
    """

    what: str
    factor: float
    length: int = 1
    number: int = 1
    rate: float = RATE
    candidates: int = len(REGISTRY)


def cases(most: int) -> list[Case]:
    """What is measured: first what all others are compared with."""
    middle = max(2, round(most**0.5))
    return [
        Case("", 1.0),
        *(Case("length of the recordings", k, length=k) for k in (middle, most)),
        *(Case("number of recordings", k, number=k) for k in (2, 4)),
        *(Case("sample rate", k, rate=k * RATE) for k in (0.25, 4.0)),
        *(Case("candidates", k, candidates=round(k * len(REGISTRY))) for k in (0.25, 0.5)),
    ]


def write(case: Case, folder: Path) -> None:
    """Generates the campaign of a case."""
    card, rig = Sensors(sample_rate=case.rate), Rig()
    make_campaign(folder, EFFECT, SEED, sensors=card, experiments=plan(case, rig, card))


def plan(case: Case, rig: Rig, card: Sensors) -> list[Experiment]:
    """The recordings of a case, the last one held out."""
    recordings = []
    for number in range(RECORDINGS * case.number):
        generator = np.random.default_rng([SEED, number])
        parts = [multisine(rig, card, generator) for _ in range(case.length)]
        # Every other one the other way round: the hub drifts back.
        whole = np.concatenate([(-1) ** k * part.commands for k, part in enumerate(parts)])
        role = "holdout" if number == RECORDINGS * case.number - 1 else "fit"
        recordings.append(replace(parts[0], name=f"multisine-{number}", role=role, commands=whole))
    return recordings


def diagnose_alone(folder: Path, workers: int, candidates: int) -> dict[str, float | str]:
    """Diagnoses a campaign in a process of its own, with the first `candidates` effects and the one that is missing."""
    given = [sys.executable, __file__, "--one", str(folder), "--workers", str(workers)]
    done = subprocess.run(
        [*given, "--candidates", str(candidates)], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def print_one(folder: Path, workers: int, candidates: int) -> None:
    """Prints wall time [s], memory [MiB] and models simulated of one diagnosis."""
    from where_time_goes import measure

    for name in list(REGISTRY)[candidates:]:
        if name not in EFFECT:
            unregister(name)
    account = measure(folder, workers)
    models = sum(cost.models for cost in account.purposes.values())
    print(json.dumps({"seconds": account.wall, "memory": account.memory, "models": models}))


def table(rows: Sequence[tuple[Case, dict]]) -> str:
    """Returns the rows with the exponent of each: time ~ factor^exponent."""
    lines = [
        "| what grows | factor | time [s] | times as long | exponent | models simulated | memory [MiB] |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    first = rows[0][1]["seconds"]
    for case, found in rows:
        ratio = found["seconds"] / first
        exponent = f"{np.log(ratio) / np.log(case.factor):.2f}" if case.what else ""
        lines.append(
            f"| {case.what or 'a minute at 1 kHz, all candidates'} | {case.factor:g} | {found['seconds']:.0f}"
            f" | {ratio:.2f} | {exponent} | {found['models']:.0f} | {found['memory']:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description="How the time of a diagnosis grows.")
    parser.add_argument("--most", type=int, default=10, help="largest factor on the length of the recordings")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--candidates", type=int, default=len(REGISTRY), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one is not None:
        print_one(given.one, given.workers, given.candidates)
        return
    work = given.work or Path(tempfile.mkdtemp(prefix="growth-"))
    rows = []
    for number, case in enumerate(cases(given.most)):
        folder = work / f"case-{number}"
        write(case, folder)
        rows.append((case, diagnose_alone(folder, given.workers, case.candidates)))
        print(table(rows).splitlines()[-1], flush=True)
    text = f"# How a diagnosis grows\n\n`{command()}`, {describe()}\n\n{table(rows)}\n"
    RESULTS.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
