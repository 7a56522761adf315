"""Hit rates of the diagnosis on virtual benches: campaigns as laboratories record them.

    python benchmarks/benches.py [--count 60] [--first-seed 0] [--workers 2] [--scheduler ADDRESS] [--minutes M]
        [--work FOLDER]

The seed of a bench decides its kind, see `twin.virtual_rig.bench.kinds`: twelve in a row hold every kind. FOLDER is for
the campaigns, removed once judged, and for `answers.jsonl`, from which an interrupted run with the same FOLDER
continues; by default it is a new temporary one. With `--minutes`, no bench is begun later than that. The table is
printed, and written to benchmarks/results/benches.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import resumable
from machine import command, describe

from twin.campaigns.campaign import read_campaign
from twin.diagnosis.answer import Diagnosis, Prediction
from twin.diagnosis.diagnose import diagnose
from twin.errors import InputError
from twin.virtual_rig.bench import make_bench
from twin.virtual_rig.bench.kinds import PATTERN

RESULTS = Path(__file__).parent / "results" / "benches.md"
REFUSED = "refused"
"""Verdict of a campaign that is taken for unusable."""
_SIZES_WITHIN = 3.0  # standard errors
_TURNS = ("phase", "direction")  # parameters that repeat after a turn
_SAME = {"sensor-delay": "actuator-delay"}
"""What gives the same recordings: without a torque sensor, readings that all are late show a late drive."""


def solve(seed: int, folder: Path) -> dict:
    """Generates a bench and diagnoses it; returns diagnosis and truth as plain values."""
    truth = make_bench(folder, seed)
    began = time.perf_counter()
    try:
        found = _answer(diagnose(read_campaign(folder), workers=1), truth.repeatability)
    except InputError as error:
        found = {"verdict": REFUSED, "why": str(error), "adopted": {}, "ranking": [], "errors": []}
    return {**found, "truth": asdict(truth), "seconds": time.perf_counter() - began}


def _answer(found: Diagnosis, reach: Mapping[str, Mapping[str, float]]) -> dict:
    return {
        "verdict": found.verdict,
        "adopted": {e.name: [dict(e.parameters), dict(e.standard_errors)] for e in found.effects},
        "ranking": [name for name, _ in found.ranking[:5]],
        "judgements": found.to_json()["judgements"],
        "errors": [
            error
            for file, p in found.predictions.items()
            if p.role == "holdout"
            for error in _errors(p, reach[file])
        ],
    }


def _errors(prediction: Prediction, reach: Mapping[str, float]) -> list[dict[str, float]]:
    """Errors of the final model on a held-out recording by channel, in noise levels.

    `after`: of the whole simulation; `reach`: noise and repeatability of the plant together; `windows`: of simulations
    that begin anew every second, see `twin.diagnosis.windows`.
    """
    return [
        {
            "after": e.after / e.noise,
            "reach": float(np.hypot(1.0, reach[channel] / e.noise)),
            "windows": prediction.windows[channel].rms_window / e.noise,
        }
        for channel, e in prediction.errors.items()
    ]


def table(answers: Sequence[dict]) -> str:
    """Returns hits by kind and by effect, and what was not exactly right, as Markdown."""
    kinds = [
        (kind, mine)
        for kind in dict.fromkeys(PATTERN)
        if (mine := [a for a in answers if a["truth"]["kind"] == kind])
    ]
    effects = [
        (name, mine)
        for name in sorted({name for a in answers for name in a["truth"]["effects"]})
        if (mine := [a for a in answers if name in a["truth"]["effects"]])
    ]
    mistakes = Counter(_mistake(a) for a in answers if not is_right(a))
    seconds = [a["seconds"] for a in answers]
    return "\n".join(
        [
            "| kind | benches | right | first in ranking | others adopted | outside-library | sizes within 3 s.e."
            " | after/reach | windows/noise | time |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
            *(_kind_row(kind, mine) for kind, mine in [*kinds, ("all", answers)]),
            "",
            "| effect | benches | adopted | benches right | sizes within 3 s.e. |",
            "| --- | ---: | ---: | ---: | ---: |",
            *(_effect_row(name, mine) for name, mine in effects),
            "",
            f"- Time for a bench: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s, one thread each.",
            "- Not right: " + (", ".join(f"{k} ({n})" for k, n in sorted(mistakes.items())) or "none") + ".",
        ]
    )


def is_right(answer: dict) -> bool:
    """Whether a bench is answered exactly: all that is missing and nothing else, nothing, or outside the library."""
    match answer["truth"]["kind"]:
        case "nothing":
            return answer["verdict"] == "no-missing-effect"
        case "outside":
            return answer["verdict"] == "outside-library"
    found, true = (
        {_SAME.get(e, e) for e in names} for names in (answer["adopted"], answer["truth"]["effects"])
    )
    return answer["verdict"] == "explained" and found == true


def sizes_within(answer: dict, names: Sequence[str]) -> list[bool]:
    """Whether each parameter of correctly adopted effects is within three standard errors of the truth."""
    found = []
    for name in names:
        values, errors = answer["adopted"].get(name, ({}, {}))
        for parameter, true in answer["truth"]["effects"][name].items():
            if errors.get(parameter):
                off = values[parameter] - true
                off = float(np.angle(np.exp(1j * off))) if parameter in _TURNS else off
                found.append(abs(off) <= _SIZES_WITHIN * errors[parameter])
    return found


def _kind_row(kind: str, mine: Sequence[dict]) -> str:
    missing = [set(a["truth"]["effects"]) for a in mine]
    errors = [e for a in mine for e in a["errors"]]
    cells = [
        kind,
        len(mine),
        sum(is_right(a) for a in mine),
        sum(bool(set(a["ranking"][:1]) & m) for a, m in zip(mine, missing, strict=True)),
        sum(bool(set(a["adopted"]) - m) for a, m in zip(mine, missing, strict=True)),
        sum(a["verdict"] == "outside-library" for a in mine),
        _share([ok for a in mine for ok in sizes_within(a, list(a["truth"]["effects"]))]),
        _median([e["after"] / e["reach"] for e in errors]),
        _median([e["windows"] for e in errors]),
        f"{np.median([a['seconds'] for a in mine]):.0f} s",
    ]
    return "| " + " | ".join(str(c) for c in cells) + " |"


def _effect_row(name: str, mine: Sequence[dict]) -> str:
    adopted = sum(name in a["adopted"] for a in mine)
    right = sum(is_right(a) for a in mine)
    sizes = _share([ok for a in mine for ok in sizes_within(a, [name])])
    return f"| {name} | {len(mine)} | {adopted} | {right} | {sizes} |"


def _mistake(answer: dict) -> str:
    missing = "+".join(answer["truth"]["effects"]) or "(nothing)"
    found = "+".join(answer["adopted"])
    return f"{missing} -> {found + ', ' if found else ''}{answer['verdict']}"


def _share(held: Sequence[bool]) -> str:
    return f"{sum(held)} of {len(held)}" if held else "-"


def _median(values: Sequence[float]) -> str:
    return f"{np.median(values):.2f}" if values else "-"


def main() -> None:
    """Runs the benches without an answer, prints the table and writes it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", dest="jobs", type=int, default=2, help="benches side by side")
    resumable.add_scheduler(parser)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no bench later than that")
    parser.add_argument("--work", type=Path, help="folder of an interrupted run")
    options = parser.parse_args()
    options.work = options.work or Path(tempfile.mkdtemp(prefix="benches-"))
    print(f"answers in {options.work}", flush=True)
    seeds = range(options.first_seed, options.first_seed + options.count)
    answers = resumable.answers({f"bench-{seed}": seed for seed in seeds}, solve, options)
    if not answers:
        parser.error("no bench was begun; expected at least one, in more --minutes")
    text = f"`{command()}`, {describe()}, {len(answers)} of {len(seeds)} benches\n\n{table(answers)}\n"
    print(text)
    RESULTS.write_text(f"# Virtual benches\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main()
