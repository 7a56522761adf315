"""Hit rates of the diagnosis on campaigns of the virtual rig with known undeclared effects.

    python benchmarks/diagnosis.py WORK [--each 5] [--small 0] [--nulls 20] [--pairs 20] [--triples 5] [--far 0]
        [--outside 20] [--seed 1000] [--engine virtual-rig] [--jobs 2] [--scheduler ADDRESS] [--dirty] [--whole]
        [--minutes M]

WORK is a folder for the campaigns and `answers.jsonl`; an interrupted run continues from it. With `--minutes`, no
campaign is begun later than that, and the table contains those that are finished. Verdict and ranking are those of the
search, values those of the last fit; `--whole` also simulates the held-out recordings. The campaigns are made by
the virtual rig's own engine; with `--engine exudyn` by Exudyn's (`exudyn_rig`), with `both` half and half.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np
import resumable
from cases import DEPENDS, NAMED, SIZES, Case, Engine, Kind, cases
from machine import describe

from twin.campaigns.campaign import Campaign, read_campaign
from twin.diagnosis import dependence, link_functions
from twin.diagnosis.answer import Diagnosis
from twin.diagnosis.conclude import (
    effect_probabilities,
    explanatory_variables,
    judgements_of,
    standard_errors,
    verdict_of,
)
from twin.diagnosis.diagnose import FALSE_ALARM_RATE, diagnose, search
from twin.diagnosis.remainder import residual_sizes
from twin.diagnosis.rules import SCREENING, alternatives
from twin.diagnosis.state import SearchState
from twin.effects import REGISTRY
from twin.errors import InputError
from twin.estimation.fit import Fit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.static_friction import final_models
from twin.virtual_rig import campaign_writer, make_campaign

ENGINES: dict[str, tuple[Engine, ...]] = {
    "both": ("virtual-rig", "exudyn"),
    "virtual-rig": ("virtual-rig",),
    "exudyn": ("exudyn",),
}


def solve(case: Case, folder: Path, whole: bool) -> dict:
    """Generates a campaign and diagnoses it; returns diagnosis and truth as plain values."""
    truth = make_campaign(
        folder,
        case.effects(),
        case.seed,
        perturb=case.perturb,
        dirty=case.dirty,
        motor_torque=case.torque_sensor,
        force=True,
        engine=_engine(case.engine),
    )
    began = time.perf_counter()
    campaign = read_campaign(folder)
    found = _full_diagnosis(diagnose(campaign, workers=1)) if whole else _search_only(campaign)
    return found | {
        "kind": case.kind,
        "missing": [NAMED.get(name, name) for name in case.missing],
        "truth": {NAMED.get(name, name): dict(values) for name, values in truth.effects.items()},
        "rig": dict(truth.true),
        "dirty": list(case.dirty),
        "torque_sensor": case.torque_sensor,
        "engine": case.engine,
        "seconds": time.perf_counter() - began,
    }


def _engine(name: Engine) -> campaign_writer.Engine:
    """Returns an engine; that of Exudyn is imported only where it is used.

    Raises:
        InputError: Exudyn is not installed.
    """
    if name == "virtual-rig":
        return campaign_writer.ritz_engine
    from exudyn_rig import exudyn_engine

    return exudyn_engine


def _full_diagnosis(result: Diagnosis) -> dict:
    held_out = [p for p in result.predictions.values() if p.role == "holdout"]
    return {
        "verdict": result.verdict,
        "adopted": [e.name for e in result.effects],
        "ranking": [name for name, _ in result.ranking[:5]],
        "probabilities": {e.name: e.probability for e in result.effects},
        "values": {e.name: dict(e.parameters) for e in result.effects},
        "errors": {e.name: dict(e.standard_errors) for e in result.effects},
        "alike": [list(names) for names in result.indistinguishable],
        "depends": list(result.depends_on),
        "after": [e.after / e.noise for p in held_out for e in p.errors.values()],
    }


def _search_only(campaign: Campaign) -> dict:
    with ResidualPool(1) as pool:
        found = search(campaign, pool)
        last = final_models(
            found.data,
            found.base,
            found.best,
            found.start.declared,
            pool,
            verdict_of(found) != "outside-library",
        )
        fit, outside = last.augmented, verdict_of(found) == "outside-library"
        left = dependence.unexplained_residuals(found.bench, found.best) if outside else {}
        on_link = link_functions.find_functions(found, FALSE_ALARM_RATE)
    return {
        "verdict": verdict_of(found),
        "adopted": [c.effects[-1] for c in found.adopted],
        "ranking": [c.name for c in found.rounds[0].ranked[:5]],
        "probabilities": effect_probabilities(found, verdict_of(found)),
        "values": {name: dict(p) for name, p in fit.model.effects.items()},
        "errors": {name: standard_errors(fit, name) for name in fit.model.effects},
        "calibrated": _calibrated(found.best),
        "alike": [list(names) for names in alternatives([r.ranked for r in found.adopting])],
        "depends": list(explanatory_variables(found, left, on_link)),
        "rounds": _rounds(found),
        "failed": _failed(found),
        "size": max(residual_sizes(found.start.bench, found.base).values()),
    }


def _calibrated(best: Fit) -> dict[str, tuple[float, float]]:
    """Declared parameter -> its value and standard error in the fit of the final model."""
    return {
        str(u.name): (float(value), float(error))
        for u, value, error in zip(best.unknowns, best.values, best.errors, strict=True)
        if u.kind == "rig"
    }


def _rounds(found: SearchState) -> list[dict]:
    """The misfit before each round, its best scores and its threshold."""
    before = [(found.start.bench, found.base), *((r.bench, r.adopted.fit) for r in found.adopting)]
    return [
        {
            "left": bench.misfit(fit.residual),
            "best": [(c.name, c.score) for c in r.ranked[:3]],
            "threshold": r.threshold,
        }
        for (bench, fit), r in zip(before, found.rounds, strict=False)
    ]


def _failed(found: SearchState) -> dict[str, dict[str, list[str]]]:
    """Candidate that was fitted -> number of the round, "None" for a later withdrawal -> rules that turned it down."""
    failed: dict[str, dict[str, list[str]]] = {}
    for name, judgements in judgements_of(found).items():
        for j in judgements:
            if j.judgement.rule not in {rule.name for rule in SCREENING}:
                against = failed.setdefault(name, {}).setdefault(str(j.round), [])
                against.extend([] if j.judgement.passed else [j.judgement.rule])
    return failed


def table(answers: Sequence[dict]) -> str:
    """Returns the confusion table and summary statistics as Markdown."""
    lines = [
        "| missing | campaigns | first in ranking | adopted alone | adopted with others | nothing adopted"
        " | other adopted | outside-library | parameter error |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    singles = [a for a in answers if a["kind"] == "single"]
    for effect in SIZES:
        mine = [a for a in singles if a["missing"] == [effect]]
        if mine:
            lines.append("| " + " | ".join(str(c) for c in _row(effect, mine)) + " |")
    return "\n".join([*lines, "", *_figures(answers, singles), *_by_engine(answers)])


def _row(effect: str, mine: Sequence[dict]) -> list:
    errors = [e for a in mine if (e := parameter_error(a)) is not None]
    middle = f"{100 * np.median(errors):.1f} %" if errors else "-"
    counts = Counter(_adoption(a) for a in mine)
    first = sum(a["ranking"][:1] == [effect] for a in mine)
    outside = sum(a["verdict"] == "outside-library" for a in mine)
    return [
        effect,
        len(mine),
        first,
        *(counts[k] for k in ("alone", "with", "none", "other")),
        outside,
        middle,
    ]


def _figures(answers: Sequence[dict], singles: Sequence[dict]) -> list[str]:
    kinds = {
        kind: [a for a in answers if a["kind"] == kind]
        for kind in ("pair", "triple", "far", "nothing", "outside")
    }
    first = sum(a["ranking"][:1] == a["missing"] for a in singles)
    alone = sum(a["adopted"] == a["missing"] for a in singles)
    alarms = sum(a["verdict"] != "no-missing-effect" for a in kinds["nothing"])
    seen = sum(a["verdict"] == "outside-library" for a in kinds["outside"])
    named = sum(a["depends"][:1] in [[v] for v in DEPENDS[a["missing"][0]]] for a in kinds["outside"])
    claimed = sum(a["verdict"] == "outside-library" for a in answers if a["kind"] != "outside")
    seconds = [a["seconds"] for a in answers]
    others = Counter(
        f"{'+'.join(a['missing']) or '(nothing)'} -> {'+'.join(a['adopted']) or a['verdict']}"
        for a in answers
        if _is_wrong(a) and a["kind"] != "small"
    )
    return [
        f"- One effect: first in the ranking in {first} of {len(singles)}, adopted alone in {alone}.",
        f"- Two effects: {_adopted_of_several(kinds['pair'])}.",
        f"- Three effects: {_adopted_of_several(kinds['triple'])}.",
        f"- One effect far beyond the usual sizes: adopted alone in {sum(not _is_wrong(a) for a in kinds['far'])}"
        f" of {len(kinds['far'])}.",
        f"- Nothing missing: {alarms} false alarms in {len(kinds['nothing'])}.",
        f"- Outside the library: recognised in {seen} of {len(kinds['outside'])}, a right variable first in {named}.",
        f"- Outside the library claimed of {claimed} others.",
        *_by_defect(answers),
        *_held_out(answers),
        *_reliability(answers),
        f"- Time for a campaign: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s, one thread each.",
        "",
        "Not exactly right: " + (", ".join(f"{k} ({n})" for k, n in sorted(others.items())) or "none") + ".",
        *_detection(answers),
    ]


def _detection(answers: Sequence[dict]) -> list[str]:
    """Hits by the largest RMS residual of a recording and channel after calibration, for single effects."""
    edges = (0.0, 1.1, 1.2, 1.4, 2.0, 5.0, np.inf)
    sized = [a for a in answers if a["kind"] in ("single", "small", "far") and "size" in a]
    lines = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = [a for a in sized if low <= a["size"] < high]
        if inside:
            first = sum(a["ranking"][:1] == a["missing"] for a in inside)
            alone = sum(a["adopted"] == a["missing"] for a in inside)
            other = sum(bool(set(a["adopted"]) - set(a["missing"])) for a in inside)
            limits = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
            lines.append(f"| {limits} | {len(inside)} | {first} | {alone} | {other} |")
    head = "| noise levels left by the calibration | campaigns | first in ranking | adopted alone | others adopted |"
    return ["", head, "| --- | --- | --- | --- | --- |", *lines] if lines else []


def _by_engine(answers: Sequence[dict]) -> list[str]:
    """Exactly correct diagnoses by engine and kind, where there are two engines."""
    engines = sorted({a.get("engine", "virtual-rig") for a in answers})
    kinds = [kind for kind in get_args(Kind) if any(a["kind"] == kind for a in answers)]
    if len(engines) < 2:
        return []
    lines = [
        "",
        "| exactly right, by engine | " + " | ".join(kinds) + " |",
        "| --- " * (len(kinds) + 1) + "|",
    ]
    for engine in engines:
        mine = [a for a in answers if a.get("engine", "virtual-rig") == engine]
        of_kind = [[not _is_wrong(a) for a in mine if a["kind"] == kind] for kind in kinds]
        lines.append(f"| {engine} | " + " | ".join(f"{sum(k)} of {len(k)}" for k in of_kind) + " |")
    return lines


def _adopted_of_several(answers: Sequence[dict]) -> str:
    """How many of several effects are adopted, as a phrase."""
    found = [len(set(a["missing"]) & set(a["adopted"])) for a in answers]
    every = sum(n == len(a["missing"]) for n, a in zip(found, answers, strict=True))
    all_but_one = sum(n >= len(a["missing"]) - 1 for n, a in zip(found, answers, strict=True))
    return f"all adopted in {every} of {len(answers)}, all but one at least in {all_but_one}"


def _held_out(answers: Sequence[dict]) -> list[str]:
    after = [np.median(a["after"]) for a in answers if a.get("after") and not _is_wrong(a)]
    lines = []
    if after:
        lines.append(
            f"- Error on held-out recordings after a right answer, median over channels, in noise levels: "
            f"median {np.median(after):.2f}, worst {max(after):.1f}."
        )
    covered, without_play = coverage(answers)
    if covered:
        lines.append(
            f"- 95 % intervals of adopted effects that hold the truth: {share_of(covered)};"
            f" of rigs without a play: {share_of(without_play)}."
        )
    known = [c for a in answers for c in _calibrated_cover(a)]
    if known:
        of = sum("calibrated" in a for a in answers)
        lines.append(
            f"- 95 % intervals of declared parameters that hold the truth, of right answers with them"
            f" ({of} have them): {share_of(known)}."
        )
    return lines


def coverage(answers: Sequence[dict]) -> tuple[list[bool], list[bool]]:
    """Whether each interval of an adopted effect contains the truth: of all rigs, and of those without a play."""
    whole = [(c, "backlash" in a["missing"]) for a in answers for c in _intervals_cover(a)]
    return [c for c, _ in whole], [c for c, has_play in whole if not has_play]


def share_of(found: Sequence[bool]) -> str:
    """How many of these are true, as text."""
    percent = f" ({100 * np.mean(found):.0f} %)" if found else ""
    return f"{sum(found)} of {len(found)}{percent}"


def _calibrated_cover(a: dict) -> list[bool]:
    """Whether the interval of each declared parameter contains the truth; none where the model is wrong."""
    if _is_wrong(a) or a["kind"] == "outside":
        return []
    return [
        abs(value - a["rig"][name]) <= 1.96 * error
        for name, (value, error) in a.get("calibrated", {}).items()
    ]


def _reliability(answers: Sequence[dict]) -> list[str]:
    """Share of adopted effects that are truly missing, by verdict and stated probability."""
    verdicts = ("explained", "outside-library")
    return [line for v in verdicts for line in _reliability_of(v, [a for a in answers if a["verdict"] == v])]


def _reliability_of(verdict: str, answers: Sequence[dict]) -> list[str]:
    """The same for campaigns of one verdict."""
    said = [(p, name in a["missing"]) for a in answers for name, p in a["probabilities"].items()]
    edges = (0.0, 0.6, 0.9, 0.99, 1.0 + 1e-9)
    parts = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = [right for p, right in said if low <= p < high]
        if inside:
            parts.append(f"{100 * low:.0f} to {100 * min(high, 1):.0f} %: {sum(inside)} of {len(inside)}")
    return (
        [f"- Adopted effects that are missing indeed, by stated probability, {verdict}: {'; '.join(parts)}."]
        if parts
        else []
    )


def _intervals_cover(a: dict) -> list[bool]:
    """Whether each interval of the correctly adopted effects contains the truth; phases modulo a turn."""
    found = []
    for name in set(a["missing"]) & set(a["values"]):
        for parameter, true in a["truth"][name].items():
            error = a["errors"].get(name, {}).get(parameter)
            if error:
                off = a["values"][name][parameter] - true
                if parameter in ("phase", "direction"):
                    off = float(np.angle(np.exp(1j * off)))
                found.append(abs(off) <= 1.96 * error)
    return found


def _by_defect(answers: Sequence[dict]) -> list[str]:
    """Share of exactly correct diagnoses, by kind of defect in the data."""
    kinds = sorted({kind for a in answers for kind in a["dirty"]})
    parts = []
    for kind in kinds:
        mine = [a for a in answers if kind in a["dirty"]]
        parts.append(f"{kind} {sum(not _is_wrong(a) for a in mine)} of {len(mine)}")
    return [f"- Exactly right, by defects in the data: {', '.join(parts)}."] if parts else []


def _adoption(a: dict) -> str:
    """Whether the missing effect was adopted: "alone", "with" others, not but an "other" one, or "none"."""
    if not a["adopted"]:
        return "none"
    if a["missing"][0] not in a["adopted"]:
        return "other"
    return "alone" if len(a["adopted"]) == 1 else "with"


def _is_wrong(a: dict) -> bool:
    """Whether a diagnosis is not exactly correct."""
    match a["kind"]:
        case "nothing":
            return a["verdict"] != "no-missing-effect"
        case "outside":
            return a["verdict"] != "outside-library"
    return a["verdict"] != "explained" or set(a["adopted"]) != set(a["missing"])


def parameter_error(a: dict) -> float | None:
    """Returns the error of the first parameter over its distance from neutral; None if the effect was not adopted."""
    effect = a["missing"][0]
    if effect not in a["values"]:
        return None
    parameter = next(
        p for p in REGISTRY[effect].parameters if p.name not in REGISTRY[effect].undefined_at_neutral
    )
    declared = {"tip_mass": 0.155, "bending_stiffness": 0.24957, "static_positive": 0.065}
    neutral = declared[parameter.name] if parameter.neutral is None else parameter.neutral
    value, true = a["values"][effect][parameter.name], a["truth"][effect][parameter.name]
    return abs(parameter.turned(value) - parameter.turned(true)) / abs(
        parameter.turned(true) - parameter.turned(neutral)
    )


def main() -> None:
    """Runs the campaigns without an answer and prints the table."""
    parser = resumable.parser(__doc__, jobs=2)
    parser.add_argument("--each", type=int, default=5, help="campaigns of each effect")
    parser.add_argument(
        "--small", type=int, default=0, help="campaigns of each effect, smaller, down to the noise"
    )
    parser.add_argument("--nulls", type=int, default=20, help="campaigns with nothing missing")
    parser.add_argument("--pairs", type=int, default=20, help="campaigns with two effects")
    parser.add_argument("--triples", type=int, default=5, help="campaigns with three effects")
    parser.add_argument(
        "--far", type=int, default=0, help="campaigns with one effect far beyond the usual sizes"
    )
    parser.add_argument("--outside", type=int, default=20, help="campaigns with a fault outside the library")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument(
        "--engine", choices=list(ENGINES), default="virtual-rig", help="what makes the campaigns"
    )
    parser.add_argument("--dirty", action="store_true", help="every campaign has a defect in its data")
    parser.add_argument("--whole", action="store_true", help="with the last fit and the held-out recordings")
    options = parser.parse_args()
    numbers = {
        k: getattr(options, k)
        for k in ("each", "small", "nulls", "pairs", "triples", "far", "outside", "seed")
    }
    try:
        for engine in ENGINES[options.engine]:
            _engine(engine)
    except InputError as error:
        parser.error(f"{error} Or give --engine virtual-rig.")
    todo = cases(**numbers, dirty=options.dirty, engines=ENGINES[options.engine])
    tasks = {case.name: case for case in todo}
    found = resumable.answers(tasks, partial(solve, whole=options.whole), options)
    given = " ".join(f"--{k} {number}" for k, number in numbers.items()) + f" --engine {options.engine}"
    given += "".join(f" --{flag}" for flag in ("dirty", "whole") if getattr(options, flag))
    print(
        f"`python benchmarks/diagnosis.py WORK {given}`, {describe()},"
        f" {len(found)} of {len(tasks)} campaigns\n"
    )
    print(table(found))


if __name__ == "__main__":
    main()
