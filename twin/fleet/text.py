"""The answer over a fleet in words: a line for each rig, the rows of its table, sentences over all rigs."""

from __future__ import annotations

from twin import labels
from twin.fleet.answer import Fleet, RigAnswer, RigResult
from twin.fleet.stored import StoredEffect, known

COLUMNS = ("rig", "verdict", "lacks", "how sure", "since its last campaign")
_NOTHING = "–"
_MOST_NAMED = 3
"""Rigs that could not be diagnosed, by name."""


def line(result: RigResult) -> str:
    """Returns the result of a rig in one line."""
    if not isinstance(result, RigAnswer):
        return f"{result.rig} ({result.campaign}): {result.error}"
    a = result.answer
    found = ", ".join(f"{labels.words(e.name)} ({sure(e)})" for e in a.effects)
    took = "already answered" if result.reused else labels.duration(a.wall_s)
    changed = [since(result)] if result.previous is not None else []
    return f"{result.rig}: {'; '.join([verdict(result), *([found] if found else []), *changed, took])}"


def verdict(rig: RigAnswer) -> str:
    """Returns the verdict, and outside the library on what the fault depends most."""
    a = rig.answer
    on = f", depends on {labels.variable(a.depends_on[0]).label}" if a.depends_on else ""
    return f"{labels.words(a.verdict)}{on if a.verdict == 'outside-library' else ''}"


def lacks(rig: RigAnswer) -> str:
    """Returns the effects that the model of a rig lacks."""
    return ", ".join(labels.words(e.name) for e in rig.answer.effects) or _NOTHING


def how_sure(rig: RigAnswer) -> str:
    """Returns the probability of each effect, and which others explain the recordings nearly as well."""
    return ", ".join(_with_rivals(rig, e) for e in rig.answer.effects) or _NOTHING


def _with_rivals(rig: RigAnswer, effect: StoredEffect) -> str:
    rivals = [labels.words(name) for name in rig.answer.rivals(effect.name)]
    return sure(effect) + (f" (or {' or '.join(rivals)})" if rivals else "")


def sure(effect: StoredEffect) -> str:
    """Returns the probability of an effect."""
    return labels.probability(known(effect.probability))


def since(rig: RigAnswer) -> str:
    """Returns what changed since the last campaign of a rig."""
    if rig.previous is None:
        return "first campaign"
    return "; ".join(c.text for c in rig.changes) or "no change"


def row(result: RigResult) -> tuple[str, str, str, str, str]:
    """Returns the cells of `COLUMNS`."""
    if not isinstance(result, RigAnswer):
        return result.rig, "not diagnosed", _NOTHING, _NOTHING, _NOTHING
    return result.rig, verdict(result), lacks(result), how_sure(result), since(result)


def headline(fleet: Fleet) -> str:
    """Returns how many rigs lack something, and which could not be diagnosed, in a sentence."""
    if not fleet.answers:
        return "No rig was diagnosed."
    count, missing = len(fleet.rigs), sum(r.answer.verdict != "no-missing-effect" for r in fleet.answers)
    rigs, have = "rig" if count == 1 else "rigs", "has" if missing == 1 else "have"
    return f"Of {count} {rigs}, {missing or 'none'} {have} a model that lacks something{_failed(fleet)}."


def _failed(fleet: Fleet) -> str:
    """A clause on the rigs that could not be diagnosed; "" without any."""
    names = [f.rig for f in fleet.failures]
    if not names:
        return ""
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return f", and {labels.join_with_and([*names[:_MOST_NAMED], *more])} could not be diagnosed"


def remarks(fleet: Fleet) -> list[str]:
    """Returns what else holds over all rigs, in sentences."""
    changed = sum(bool(r.changes) for r in fleet.answers)
    compared = sum(r.previous is not None for r in fleet.answers)
    reused = sum(r.reused for r in fleet.answers)
    said = [
        (compared, f"{changed} of {compared} differ from the last campaign of the same rig."),
        (reused, f"{reused} had an answer of the same files already."),
    ]
    return [sentence for number, sentence in said if number]


def effects(fleet: Fleet) -> list[tuple[str, str, str]]:
    """Returns effect, number of rigs that lack it, and their names; the most frequent effect first."""
    return [(labels.words(name), str(len(rigs)), ", ".join(rigs)) for name, rigs in fleet.effects.items()]
