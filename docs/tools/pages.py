"""Pages of the documentation that are made from the source: effects, commands, notebooks."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import typer.main

from twin.cli import app
from twin.effects import REGISTRY, Effect, catalogue
from twin.labels import unit

REPOSITORY = "https://github.com/flexlink-twin/flexlink-twin/blob/main/"


def notebook_page(path: Path) -> str:
    """The cells of a notebook with the outputs that it is kept with, see run_notebooks.py."""
    parts: list[str] = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
        parts += [_output(output["data"]) for output in cell.get("outputs", ())]
    return "\n\n".join([*parts, f"[The notebook]({REPOSITORY}docs/examples/{path.name})"]) + "\n"


def _output(data: Mapping[str, Any]) -> str:
    """What a cell returned: a picture, a table, or text."""
    if "image/png" in data:
        return f"![What the cell draws](data:image/png;base64,{data['image/png'].strip()})"
    if "text/html" in data:
        return "".join(data["text/html"]).replace(
            "<table>", '<table class="table">'
        )  # as the theme draws them
    return f"```text\n{''.join(data['text/plain'])}\n```"


def effect_page(effect: Effect, size: Mapping[str, float]) -> str:
    """The page of an effect, from its class; `size` is one that a rig may well have."""
    rows = [
        f"| `{p.name}` | {unit(p.unit) or '1'} | {_neutral(p.neutral)} | {' to '.join(map(_plain, p.bounds))} |"
        for p in effect.parameters
    ]
    alike = effect.mistaken_for | {
        name: other.mistaken_for[effect.name]
        for name, other in REGISTRY.items()
        if effect.name in other.mistaken_for
    }
    confused = [f"| [`{name}`]({name}.md) | {what} |" for name, what in alike.items()]
    more = (type(effect).__doc__ or "").partition("\n\n")[2]
    parts = [
        f"# {effect.name.replace('-', ' ').capitalize()}",
        f"`{effect.name}`: {effect.meaning}. Acts on: {effect.acts_on}.",
        f"## Law\n\n{catalogue.law(effect)}.",
        re.sub(r"\s*\n\s*", " ", more).strip().replace("*", r"\*"),
        f"Source: {effect.source}." if effect.source else "",
        "## Parameters",
        "\n".join(["| parameter | unit | neutral | range of a search |", "| --- | --- | --- | --- |", *rows]),
        f"## How it looks in recordings\n\n{effect.seen_as}",
        f"![Hub angle with and without the effect, and what it changes](pictures/effects/{effect.name}.svg)",
        "A slew to and fro without the effect (grey) and with it (blue), and the differences, on `bossi2009` with "
        f"little static friction; {_sizes(effect, size)}.",
        "## What it is mistaken for",
        "\n".join(["| effect | what tells the two apart |", "| --- | --- |", *confused])
        if confused
        else "Nothing known.",
        f"## To try it\n\n```sh\n{_trial(effect, size)}\ntwin diagnose try\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _neutral(value: float | None) -> str:
    return "as declared" if value is None else _plain(value)


def _plain(value: float) -> str:
    """A number with three significant digits and without an exponent."""
    return "∞" if value == math.inf else np.format_float_positional(float(f"{value:.3g}"), trim="-")


def _trial(effect: Effect, size: Mapping[str, float]) -> str:
    """A command that makes recordings of a virtual rig with the effect."""
    values = ",".join(f"{name}={value:g}" for name, value in size.items())
    return f"twin virtual-rig --out try --effect {effect.name}:{values}"


def _sizes(effect: Effect, size: Mapping[str, float]) -> str:
    """The values with their units: "tilt 0.02 rad, direction 1.1 rad"."""
    units = effect.units(size)
    return ", ".join(f"`{name}` {_plain(value)} {unit(units[name])}".strip() for name, value in size.items())


def commands_page() -> str:
    """Every command with its arguments and options, from the parser of the command line."""
    group = typer.main.get_command(app)  # a click Group, of typer's own copy of click
    parts = ["# Commands", "From the command line's own parser: what `twin COMMAND --help` prints."]
    for name, command in group.commands.items():
        usage = " ".join(
            [f"twin {name}", *(_usage(p) for p in command.params if p.param_type_name == "argument")]
        )
        parts += [f"## twin {name}", f"```\n{usage}\n```", _escaped(command.help or "")]
        options = [p for p in command.params if p.param_type_name == "option" and not p.hidden]
        rows = [f"| `{', '.join(p.opts)}` | {_escaped(p.help or '')} | {_default(p)} |" for p in options]
        if rows:
            parts.append("\n".join(["| option | meaning | default |", "| --- | --- | --- |", *rows]))
    return "\n\n".join(parts) + "\n"


def _usage(argument: Any) -> str:
    name = (argument.metavar or argument.name or "").strip("[]").upper()
    name = name if argument.nargs == 1 else f"{name}..."
    return name if argument.required else f"[{name}]"


def _default(option: Any) -> str:
    value = option.default
    return "" if value is None or callable(value) or value is False or value == () else f"`{value}`"


def _escaped(text: str) -> str:
    return re.sub(r"\s*\n\s*", " ", text).replace("|", r"\|").replace("*", r"\*").replace("<", "&lt;")
