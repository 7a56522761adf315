"""What each rule decides alone: candidates that it turns down and every other rule of their round would adopt.

    python benchmarks/rules.py --bench WORK/answers.jsonl
    python benchmarks/rules.py --diagnosis WORK/answers.jsonl
    python benchmarks/rules.py --campaigns ANSWERS TRUTH.json
    python benchmarks/rules.py --later FILE [FILE ...]

WORK is the folder of `benches.py`, and of `diagnosis.py`, whose answers hold only what was fitted; ANSWERS holds
`NAME.json`, written by `twin diagnose FOLDER --json NAME.json`, for each campaign of TRUTH, which is {"campaigns":
{NAME: {"effects": [{"name": EFFECT}, ...]}}}. This is the first order of an ablation: without a rule that turns down
nothing alone, no candidate is adopted instead of being turned down. What the search would have found after another
decision is not told. The table is printed, and written to benchmarks/results/rules.md.

With `--later` only the scores of effects beside earlier ones are printed, of answers of `diagnosis.py`: of those that
are missing, and of the best candidates beside all that is missing, which gain by the error of the model alone.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from machine import command

from twin.diagnosis import rules

RESULTS = Path(__file__).parent / "results" / "rules.md"
Judged = Mapping[str, Sequence[Mapping]]
"""Candidate -> its judgements as in the JSON of an answer."""


def of_bench(file: Path) -> Iterator[tuple[Judged, set[str]]]:
    """Judgements and missing effects of each answer of `benches.py` that has judgements: no refused campaign has."""
    for line in file.read_text(encoding="utf-8").splitlines():
        answer = json.loads(line)["answer"]
        if "judgements" in answer:
            yield answer["judgements"], set(answer["truth"]["effects"])


def of_diagnosis(file: Path) -> Iterator[tuple[Judged, set[str]]]:
    """Judgements of the fitted candidates, and missing effects, of each answer of `diagnosis.py` that has them."""
    for line in file.read_text(encoding="utf-8").splitlines():
        answer = json.loads(line)["answer"]
        if "failed" in answer:
            judged = {name: list(_judgements(rounds)) for name, rounds in answer["failed"].items()}
            yield judged, set(answer["missing"])


def _judgements(failed: Mapping[str, Sequence[str]]) -> Iterator[dict]:
    """Judgements of a candidate; those of a round that failed, and each rule of adoption, which every round asks."""
    for number, against in failed.items():
        asked = [rule.name for rule in rules.ADOPTION] if number != "None" else []
        for rule in dict.fromkeys([*asked, *against]):
            yield {"round": number, "rule": rule, "passed": rule not in against}


def of_campaigns(folder: Path, truth: Path) -> Iterator[tuple[Judged, set[str]]]:
    """Judgements and missing effects of each campaign with an answer."""
    for name, campaign in json.loads(truth.read_text(encoding="utf-8"))["campaigns"].items():
        file = folder / f"{name}.json"
        if file.exists():
            missing = {effect["name"] for effect in campaign["effects"]}
            yield json.loads(file.read_text(encoding="utf-8"))["judgements"], missing


def together(answers: Sequence[tuple[Judged, set[str]]]) -> str:
    """Sets of rules by which the best candidates of a round were turned down, as Markdown."""
    sets = Counter[str]()
    for judgements, _ in answers:
        for own in judgements.values():
            for judged in _by_round(own):
                against = {j["rule"] for j in judged if not j["passed"]}
                if against and "best-of-round" in {j["rule"] for j in judged} - against:
                    sets[", ".join(sorted(against))] += 1
    rows = [f"| {names} | {count} |" for names, count in sets.most_common()]
    head = ["| rules that turned down the best candidate of a round | rounds |", "| --- | ---: |"]
    return "\n".join([*head, *rows])


def _by_round(own: Sequence[Mapping]) -> list[list[Mapping]]:
    """Judgements of a candidate, those of each round together."""
    rounds = defaultdict[int, list[Mapping]](list)
    for j in own:
        rounds[j["round"]].append(j)
    return list(rounds.values())


def table(answers: Sequence[tuple[Judged, set[str]]]) -> str:
    """How often each rule judged, failed, failed alone, and whether the effect was missing then, as Markdown."""
    judged, failed, alone, right = Counter[str](), Counter[str](), Counter[str](), Counter[str]()
    for judgements, missing in answers:
        for name, own in judgements.items():
            for at_once in _by_round(own):
                judged.update(j["rule"] for j in at_once)
                against = [j["rule"] for j in at_once if not j["passed"]]
                failed.update(against)
                if len(against) == 1:
                    alone.update(against)
                    right.update(against if name in missing else [])
    names = [rule.name for rule in (*rules.SCREENING, *rules.ADOPTION, *rules.REVISION)]
    rows = [f"| {name} | {judged[name]} | {failed[name]} | {alone[name]} | {right[name]} |" for name in names]
    return "\n".join(
        [
            "| rule | judged | failed | failed alone | of these, effects that are missing |",
            "| --- | ---: | ---: | ---: | ---: |",
            *rows,
        ]
    )


def of_later(file: Path) -> Iterator[tuple[bool, float, str]]:
    """Whether an effect beside earlier ones is missing, its score over the sum of theirs, and where, of one file."""
    for line in file.read_text(encoding="utf-8").splitlines():
        stored = json.loads(line)
        answer, found, gained = stored["answer"], set[str](), 0.0
        missing = set(answer["missing"])
        for done in (r for r in answer["rounds"] if r["best"]):
            name, score = done["best"][0]
            adopted = name in answer["adopted"]
            is_missing = adopted and name in missing
            # An outsider has no name, and is never found.
            is_needless = missing <= found and rules.least_score(gained) > rules.MODEL_ERROR_SCORE
            if gained > 0 and (is_missing or is_needless):
                yield is_missing, min(score, done["left"]) / gained, f"{stored['campaign']}: {name}"
            if adopted:
                found, gained = found | {name}, gained + score


def later(files: Sequence[Path]) -> str:
    """The nearest scores of effects beside earlier ones, missing and needless, as Markdown."""
    scores = [s for file in files for s in of_later(file)]
    missing = sorted((share, where) for is_missing, share, where in scores if is_missing)
    needless = sorted(((share, where) for is_missing, share, where in scores if not is_missing), reverse=True)
    rows = [
        f"| {what} | {len(of)} | {'; '.join(f'{100 * share:.2f} % ({where})' for share, where in of[:3])} |"
        for what, of in (("missing, and adopted", missing), ("beside all that is missing", needless))
    ]
    head = [
        "| effect beside earlier ones | rounds | score over theirs, nearest to the limit |",
        "| --- | ---: | --- |",
    ]
    return "\n".join([*head, *rows])


def main() -> None:
    """Prints the table of all answers and writes it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bench", type=Path, action="append", default=[], help="answers of benches.py")
    parser.add_argument("--diagnosis", type=Path, action="append", default=[], help="answers of diagnosis.py")
    parser.add_argument(
        "--campaigns",
        type=Path,
        nargs=2,
        action="append",
        default=[],
        metavar=("ANSWERS", "TRUTH"),
        help="folder of answers, and their truth",
    )
    parser.add_argument("--later", type=Path, nargs="+", help="answers of diagnosis.py")
    options = parser.parse_args()
    if options.later:
        print(f"`{command()}`\n\n{later(options.later)}")
        return
    answers = [a for file in options.bench for a in of_bench(file)]
    answers += [a for file in options.diagnosis for a in of_diagnosis(file)]
    for folder, truth in options.campaigns:
        answers += of_campaigns(folder, truth)
    if not answers:
        parser.error("no answers; expected --bench FILE, --diagnosis FILE or --campaigns FOLDER TRUTH")
    text = f"`{command()}`, {len(answers)} answers\n\n{table(answers)}\n\n{together(answers)}\n"
    print(text)
    RESULTS.write_text(f"# What each rule decides alone\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main()
