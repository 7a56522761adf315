"""Bias, error and interval coverage of identified parameters, on virtual rigs with known parameters.

    python benchmarks/identify.py WORK [--campaigns 50] [--seed 9000] [--jobs 1] [--minutes M]

WORK is a folder for the campaigns and `answers.jsonl`; an interrupted run continues from it. With `--minutes`, no
campaign is begun later than that, and the table contains those that are finished. The true parameters of each campaign
are drawn from its declared uncertainty; the model lacks no effect.
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
    """Generates a campaign and identifies it; returns estimates, true values and computation time [s]."""
    truth = make_campaign(folder, {}, seed, perturb=1.0, force=True)
    began = time.perf_counter()
    found = identify(read_campaign(folder)).to_json()
    return {"parameters": found["parameters"], "true": truth.true, "seconds": time.perf_counter() - began}


def table(answers: Sequence[dict]) -> str:
    """Returns bias, error and coverage of each parameter and procedure as Markdown."""
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
        parameter = a["parameters"][name]
        estimate = parameter if method == "identified" else parameter["methods"].get(method)
        if estimate is not None:
            off.append(estimate["value"] / a["true"][name] - 1)
            errors.append(estimate["standard_error"] / a["true"][name])
    if not off:
        return ""
    x, s = np.array(off), np.array(errors)
    cells = (f"{100 * v:.3f} %" for v in (x.mean(), np.sqrt((x**2).mean()), s.mean()))
    held = 100 * np.mean(np.abs(x) <= TWO_SIDED_95 * s)
    return f"| `{name}` | {method} | {len(x)} | {' | '.join(cells)} | {held:.0f} % |"


def main() -> None:
    """Runs the campaigns without an answer and prints the table."""
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
