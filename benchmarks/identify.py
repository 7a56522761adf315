"""How right identified parameters are, and how honest their intervals, on virtual rigs whose truth is known.

    python benchmarks/identify.py WORK [--campaigns 50] [--seed 9000] [--jobs 1] [--minutes M]

WORK is a folder for the campaigns and `answers.jsonl`; an interrupted run goes on from there. With `--minutes`, no
campaign is begun later than that, and the table is of those that are there. The true parameters of
each campaign are drawn from the uncertainty that it declares; nothing else is missing in the model.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import resumable
from machine import describe

from twin.campaigns.campaign import read_campaign
from twin.identification.estimates import TWO_SIDED_95
from twin.identification.identify import identify
from twin.virtual_rig import make_campaign


def solve(seed: int, folder: Path) -> dict:
    """Makes a campaign and identifies it."""
    truth = make_campaign(folder, {}, seed, perturb=1.0, force=True)
    began = time.perf_counter()
    found = identify(read_campaign(folder)).to_json()
    return {"parameters": found["parameters"], "true": truth.true, "seconds": time.perf_counter() - began}


def table(answers: Sequence[dict]) -> str:
    """Bias, error and coverage of each parameter and of each procedure by itself, as Markdown."""
    lines = [
        "| parameter | procedure | campaigns | bias | rms error | mean standard error | 95 % coverage |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name in answers[0]["parameters"]:
        methods = ["identified", *answers[0]["parameters"][name]["methods"]]
        lines += [row for method in methods if (row := _row(answers, name, method))]
    seconds = [a["seconds"] for a in answers]
    lines += ["", f"Time for a campaign: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s."]
    return "\n".join(lines)


def _row(answers: Sequence[dict], name: str, method: str) -> str:
    off, errors = [], []
    for a in answers:
        said = (
            a["parameters"][name] if method == "identified" else a["parameters"][name]["methods"].get(method)
        )
        if said is not None:
            off.append(said["value"] / a["true"][name] - 1)
            errors.append(said["standard_error"] / a["true"][name])
    if not off:
        return ""
    x, s = np.array(off), np.array(errors)
    cells = (f"{100 * v:.3f} %" for v in (x.mean(), np.sqrt((x**2).mean()), s.mean()))
    held = 100 * np.mean(np.abs(x) <= TWO_SIDED_95 * s)
    return f"| `{name}` | {method} | {len(x)} | {' | '.join(cells)} | {held:.0f} % |"


def main() -> None:
    """Runs what is not there yet and prints the table."""
    parser = resumable.parser(__doc__, jobs=1)
    parser.add_argument("--campaigns", type=int, default=50)
    parser.add_argument("--seed", type=int, default=9000, help="of the first campaign")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.campaigns)
    answers = resumable.answers({str(seed): seed for seed in seeds}, solve, options)
    given = f"--campaigns {options.campaigns} --seed {options.seed}"
    print(f"`python benchmarks/identify.py WORK {given}`, {describe()}, {len(answers)} campaigns\n")
    print(table(answers))


if __name__ == "__main__":
    main()
