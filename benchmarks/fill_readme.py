"""Writes the generated parts of README.md and docs/: the output of `twin demo`, and tables.

    python benchmarks/fill_readme.py [demo] [headline] [reliability] [intervals] [effects] [accuracy]
                                     [screening] [adoption] [revision] [explanation]

Without names, all of them; `demo` fills `headline`, too, from the same run. Each part stands between <!-- NAME --> and
<!-- end --> in the document that `PARTS` names.
"""

from __future__ import annotations

import functools
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from twin import labels
from twin.diagnosis import judgement, rules
from twin.effects import REGISTRY, catalogue

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
DOCS = ROOT / "docs"
DIAGNOSIS = DOCS / "diagnosis.md"
ANSWERS = {
    engine: ROOT / "benchmarks" / "results" / file
    for engine, file in {"virtual rig": "diagnosis-93000.jsonl", "Exudyn": "diagnosis-exudyn.jsonl"}.items()
}
"""Engine of the rigs -> answers of `diagnosis.py`."""


@functools.cache
def demo_run() -> tuple[str, dict[str, Any]]:
    """Runs the demo, and returns what it prints and its diagnosis.json."""
    with tempfile.TemporaryDirectory() as folder:
        twin = [sys.executable, "-m", "twin.cli", "demo"]
        printed = subprocess.run(twin, cwd=folder, check=True, capture_output=True, text=True).stdout
        answer = Path(folder) / "demo-rig-diagnosis" / "diagnosis.json"
        return printed, json.loads(answer.read_text(encoding="utf-8"))


def demo() -> str:
    """Returns the output of the demo as a code block."""
    lines = "\n".join(line.rstrip() for line in demo_run()[0].splitlines())
    return f"```console\n$ twin demo\n{lines}\n```"


def headline() -> str:
    """Returns what the demo finds, in a sentence."""
    return sentence(demo_run()[1])


def sentence(answer: Mapping[str, Any]) -> str:
    """Returns the error of the hub on the held-out recording where it is largest, before and after."""
    budget = answer["error_budget"]
    file = max(budget, key=lambda name: budget[name]["hub_angle"]["before"]["rms"])
    before, after = (
        labels.amount("hub_angle", budget[file]["hub_angle"][model]["rms"]) for model in ("before", "after")
    )
    found = [effect["name"] for effect in answer["effects"]]
    others = sorted({name for names in answer["indistinguishable"] for name in names} - set(found))
    rest = (
        f"\nThese recordings also allow for {_meanings(others)}; the answer says what to record to decide it."
    )
    return (
        f"On a recording that the diagnosis had not seen (`{file}`), the hub of the model is off by **{before}**\n"
        f"(root mean square). `twin` finds what is missing, {_meanings(found)}; with that, the model is\n"
        f"off by **{after}**.{rest if others else ''}"
    )


def _meanings(effects: Sequence[str]) -> str:
    return " and ".join(REGISTRY[name].meaning for name in effects)


KINDS: Mapping[str, str] = {
    "single": "one effect",
    "pair": "two effects",
    "triple": "three effects",
    "nothing": "nothing",
    "outside": "a fault that the library has no name for",
}
"""Kind of a campaign in the answers of the benchmark -> what its model lacks."""


def reliability() -> str:
    """Returns how many answers of the benchmark are exactly right, by what is missing and engine, as a table."""
    found = {engine: _answers(file) for engine, file in ANSWERS.items()}
    rows = [("what the model lacks", *found), ("---", *("---:" for _ in found))]
    for kind, meaning in KINDS.items():
        rows.append(
            (meaning, *(_count_right([a for a in mine if a["kind"] == kind]) for mine in found.values()))
        )
    rows.append(("all", *map(_count_right, found.values())))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)


def intervals() -> str:
    """Returns how many 95 % intervals of the effects hold the truth, in a sentence."""
    from diagnosis import coverage, share_of

    covered, without_play = coverage([answer for file in ANSWERS.values() for answer in _answers(file)])
    return (
        f"The 95 % intervals of the named effects held the truth in {share_of(covered)}, on rigs without a play in\n"
        f"{share_of(without_play)}."
    )


def _answers(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line)["answer"] for line in file.read_text(encoding="utf-8").splitlines()]


def _count_right(answers: Sequence[Mapping[str, Any]]) -> str:
    return f"{sum(map(_is_right, answers))} of {len(answers)}" if answers else ""


def _is_right(answer: Mapping[str, Any]) -> bool:
    """Whether exactly the missing effects are named, or a fault without a name is called outside the library."""
    outside = answer["verdict"] == "outside-library"
    if answer["kind"] == "outside":
        return outside
    return not outside and sorted(answer["adopted"]) == sorted(answer["missing"])


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
    "headline": (README, headline),
    "reliability": (README, reliability),
    "intervals": (README, intervals),
    "effects": (DOCS / "effects.md", effects),
    "accuracy": (DOCS / "accuracy.md", accuracy),
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
    names = sys.argv[1:] or list(PARTS)
    for name in [*names, *(["headline"] if "demo" in names and "headline" not in names else [])]:
        path, generate = PARTS[name]
        text = path.read_text(encoding="utf-8")
        path.write_text(replaced(text, name, generate()), encoding="utf-8")


if __name__ == "__main__":
    main()
