"""The registry as a Markdown table, with the effects that other packages registered."""

from __future__ import annotations

from collections.abc import Iterator

from twin.effects import REGISTRY, Effect
from twin.labels import unit


def rows() -> Iterator[tuple[str, str, str, str]]:
    """Name, meaning, law and parameters of each effect, in Markdown."""
    for name, effect in REGISTRY.items():
        parameters = ", ".join(f"`{p.name}` {unit(p.unit)}".rstrip() for p in effect.parameters)
        yield f"`{name}`", effect.meaning, law(effect), parameters


def law(effect: Effect) -> str:
    """The first paragraph of an effect's docstring, which is its law."""
    first = (type(effect).__doc__ or "").split("\n\n")[0]
    return " ".join(first.split()).rstrip(".").replace("|", r"\|").replace("*", r"\*")


def markdown() -> str:
    """The registry as a Markdown table."""
    head = ("effect", "what the model lacks", "law", "parameters")
    rule = ("---",) * len(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, rule, *rows()))
