"""How often the diagnosis is right, on campaigns of the virtual rig whose truth is known.

    python benchmarks/diagnosis.py WORK [--each 5] [--nulls 20] [--seed 1000] [--jobs 2] [--whole]

WORK is a folder for the campaigns and the answers; an interrupted run goes on from there. Every campaign has true
parameters off from the declared ones, and nulls have nothing else. The verdict and the ranking come from the search;
`--whole` also runs the last fit and simulates the held-out recordings.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from machine import describe
from rich.progress import track

from twin.campaign import read_campaign
from twin.conclude import said
from twin.diagnose import diagnose, find
from twin.effects import REGISTRY
from twin.virtual_rig import make_campaign

NOTHING = "(nothing)"
SIZES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    # smallest and largest size, drawn log-uniformly; of a gain or a share, of its distance from 1
    "viscous-friction": {"viscous": (8e-4, 5e-3)},
    "cable-torsion": {"stiffness": (3e-3, 2e-2)},
    "torque-bias": {"bias": (1e-3, 6e-3)},
    "torque-gain": {"gain": (0.02, 0.1)},
    "actuator-delay": {"delay": (3e-3, 2e-2)},
    "payload-mass": {"tip_mass": (0.04, 0.15)},
    "stiffness-loss": {"bending_stiffness": (0.07, 0.2)},
    "air-drag": {"coefficient": (0.02, 0.2)},
    "hub-sensor-gain": {"gain": (0.01, 0.06)},
    "strain-gain": {"gain_base": (0.02, 0.1), "gain_mid": (0.02, 0.1)},
    "asymmetric-friction": {"static": (0.05, 0.2), "coulomb": (2e-3, 6e-3)},
}


@dataclass(frozen=True)
class Case:
    """One campaign: which effect it lacks, and its seed."""

    effect: str
    seed: int

    @property
    def name(self) -> str:
        """A name that says nothing about the effect."""
        return f"rig-{self.seed}"


def planted(case: Case) -> dict[str, dict[str, float]]:
    """The effect of a case with a size drawn from its seed."""
    if case.effect == NOTHING:
        return {}
    draw = np.random.default_rng([case.seed, 7])

    def size(name: str) -> float:
        low, high = SIZES[case.effect][name]
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    sign = float(draw.choice([-1, 1]))
    match case.effect:
        case "cable-torsion":
            return {
                case.effect: {"stiffness": size("stiffness"), "rest_angle": float(draw.uniform(-0.5, 0.5))}
            }
        case "torque-bias":
            return {case.effect: {"bias": sign * size("bias")}}
        case "torque-gain" | "hub-sensor-gain":
            return {case.effect: {"gain": 1 + sign * size("gain")}}
        case "payload-mass":
            return {case.effect: {"tip_mass": 0.155 * (1 + sign * size("tip_mass"))}}
        case "stiffness-loss":
            return {case.effect: {"bending_stiffness": 0.24957 * (1 - size("bending_stiffness"))}}
        case "strain-gain":
            gains = {name: 1 + float(draw.choice([-1, 1])) * size(name) for name in SIZES[case.effect]}
            return {case.effect: gains}
        case "asymmetric-friction":
            static, coulomb = size("static"), size("coulomb")
            return {
                case.effect: {
                    "static_positive": 0.065 * (1 + sign * static),
                    "static_negative": 0.065 * (1 - sign * static),
                    "coulomb_positive": 0.0055 + max(0.0, sign) * coulomb,
                    "coulomb_negative": 0.0055 + max(0.0, -sign) * coulomb,
                }
            }
    return {case.effect: {name: size(name) for name in SIZES[case.effect]}}


def cases(each: int, nulls: int, seed: int) -> Iterator[Case]:
    """The campaigns, the effects taking turns so that an early stop is a fair sample."""
    effects = [name for name in REGISTRY if name in SIZES]
    number = seed
    for turn in range(max(each, -(-nulls // 4))):
        for effect in effects if turn < each else ():
            yield Case(effect, number)
            number += 1
        for _ in range(max(0, min(4, nulls - 4 * turn))):
            yield Case(NOTHING, number)
            number += 1


def answer(case: Case, work: Path, whole: bool) -> dict:
    """Makes the campaign, diagnoses it and writes the answer down; an answer that is there is kept."""
    path = work / f"{case.name}.json"
    if path.exists():
        return json.loads(path.read_text())
    folder = work / case.name
    truth = make_campaign(folder, planted(case), case.seed, perturb=0.5, force=True)
    campaign = read_campaign(folder)
    began = time.perf_counter()
    if whole:
        result = diagnose(campaign, workers=1)
        found = {
            "verdict": result.verdict,
            "adopted": [e.name for e in result.effects],
            "ranking": [name for name, _ in result.ranking],
            "values": {e.name: dict(e.parameters) for e in result.effects},
            "errors": {e.name: dict(e.standard_errors) for e in result.effects},
            "alike": [list(names) for names in result.indistinguishable],
            "after": [
                e.after / e.noise
                for p in result.predictions.values()
                if p.role == "holdout"
                for e in p.errors.values()
            ],
        }
    else:
        with ThreadPoolExecutor(1) as pool:
            search = find(campaign, pool)
        best = search.best
        found = {
            "verdict": said(search),
            "adopted": [c.effects[-1] for c in search.adopted],
            "ranking": [c.effects[-1] for c in search.rounds[0]],
            "values": {name: dict(p) for name, p in best.model.effects.items()},
            "errors": {},
            "alike": [],
        }
    found |= {
        "effect": case.effect,
        "truth": truth.effects,
        "seconds": time.perf_counter() - began,
    }
    path.write_text(json.dumps(found, indent=1))
    for file in folder.glob("*"):
        file.unlink()
    folder.rmdir()
    return found


def table(answers: list[dict]) -> str:
    """The confusion table and the figures below it, as Markdown."""
    effects = [name for name in REGISTRY if any(a["effect"] == name for a in answers)]
    lines = [
        "| missing | campaigns | first in ranking | adopted alone | adopted with others | nothing adopted"
        " | other adopted | outside-library | parameter error |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for effect in effects:
        mine = [a for a in answers if a["effect"] == effect]
        errors = [e for a in mine if (e := parameter_error(a)) is not None]
        middle = f"{100 * np.median(errors):.1f} %" if errors else "-"
        counts = Counter(_kind(a) for a in mine)
        first = sum(a["ranking"][:1] == [effect] for a in mine)
        cells = [effect, len(mine), first, *(counts[k] for k in ("alone", "with", "none", "other"))]
        outside = sum(a["verdict"] == "outside-library" for a in mine)
        lines.append("| " + " | ".join(str(c) for c in (*cells, outside, middle)) + " |")
    nulls = [a for a in answers if a["effect"] == NOTHING]
    alarms = [a for a in nulls if a["verdict"] != "no-missing-effect"]
    seconds = [a["seconds"] for a in answers]
    wrong = Counter(
        f"{a['effect']} -> {'+'.join(a['adopted']) or a['verdict']}" for a in answers if _wrong(a)
    )
    lines += [
        "",
        f"Nothing missing: {len(alarms)} false alarms in {len(nulls)} campaigns.",
        f"Time for a campaign: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s, one thread each.",
        "Wrong: " + (", ".join(f"{k} ({n})" for k, n in wrong.items()) or "none") + ".",
    ]
    return "\n".join(lines)


def _kind(a: dict) -> str:
    if not a["adopted"]:
        return "none"
    if a["effect"] not in a["adopted"]:
        return "other"
    return "alone" if len(a["adopted"]) == 1 else "with"


def _wrong(a: dict) -> bool:
    if a["effect"] == NOTHING:
        return a["verdict"] != "no-missing-effect"
    return _kind(a) != "alone"


def parameter_error(a: dict) -> float | None:
    """Error of the first parameter, relative to its distance from neutral; None where it was not found."""
    effect = a["effect"]
    if effect not in a["values"]:
        return None
    parameter = REGISTRY[effect].parameters[0]
    declared = {"tip_mass": 0.155, "bending_stiffness": 0.24957, "static_positive": 0.065}
    neutral = declared[parameter.name] if parameter.neutral is None else parameter.neutral
    true = a["truth"][effect][parameter.name]
    return abs(a["values"][effect][parameter.name] - true) / abs(true - neutral)


def main() -> None:
    """Runs what is not there yet and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path)
    parser.add_argument("--each", type=int, default=5)
    parser.add_argument("--nulls", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--whole", action="store_true")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    todo = list(cases(options.each, options.nulls, options.seed))
    answers = []
    with ProcessPoolExecutor(options.jobs) as pool:
        jobs = [pool.submit(answer, case, options.work, options.whole) for case in todo]
        for job in track(as_completed(jobs), "campaigns", len(jobs), disable=not sys.stdout.isatty()):
            answers.append(job.result())
    command = f"python benchmarks/diagnosis.py WORK --each {options.each} --nulls {options.nulls}"
    print(f"`{command} --seed {options.seed}`, {describe()}\n\n{table(answers)}")


if __name__ == "__main__":
    main()
