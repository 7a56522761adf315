"""Executes the notebooks of docs/examples and stores what their cells return: text, tables, pictures.

python docs/tools/run_notebooks.py [NAME ...]      by default all; `diagnosis` takes minutes

A figure is stored as a picture, drawn with matplotlib: an interactive one is larger than all other outputs together.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import pprint
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from drawing import LIGHT, style
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
_WIDTH = 7.5  # inch
_PIXELS = 90  # an inch
_COLOURS = 64


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Returns a notebook with the outputs of its code cells, which share their variables."""
    names: dict[str, Any] = {}
    cells, count = [], 0
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            count += 1
            value = _value("".join(cell["source"]), names)
            outputs = [] if value is None else [_output(value, count)]
            cell = {**cell, "execution_count": count, "outputs": outputs}
        cells.append(cell)
    return {**notebook, "cells": cells}


def _value(source: str, names: dict[str, Any]) -> Any:
    """What a cell returns: the value of its last line, unless that is no expression or ends in a semicolon."""
    body = ast.parse(source).body
    if not isinstance(body[-1], ast.Expr) or source.rstrip().endswith(";"):
        exec(source, names)
        return None
    exec(compile(ast.Module(body[:-1], []), "cell", "exec"), names)
    return eval(compile(ast.Expression(body[-1].value), "cell", "eval"), names)


def _output(value: Any, count: int) -> dict[str, Any]:
    """A value as a notebook stores it."""
    if isinstance(value, go.Figure):
        data = {"image/png": base64.b64encode(_png(value)).decode()}
    else:
        data = {"text/plain": pprint.pformat(value, width=100, sort_dicts=False).splitlines(keepends=True)}
        if hasattr(value, "_repr_html_"):
            data["text/html"] = [value._repr_html_()]
    return {"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": data}


def _png(figure: go.Figure) -> bytes:
    """The lines of a figure that show at first as a picture: the panels of its left column below one another."""
    layout = figure.to_plotly_json()["layout"]
    traces = [t for t in figure.data if t.visible != "legendonly" and _is_left(layout, t)]
    panels = sorted({_axis(t.yaxis) for t in traces}, key=lambda name: int(name or 1))
    with rc_context({**style(LIGHT), "font.size": 9}):
        drawn = Figure(figsize=(_WIDTH, 1.0 + 1.9 * len(panels)), layout="constrained")
        column: Sequence[Axes] = drawn.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(column, panels, strict=True):
            for trace in (t for t in traces if _axis(t.yaxis) == name):
                x, y = _numbers(trace.x), _numbers(trace.y)
                width = 0.75 * (trace.line.width or 1.6)  # pt of px
                axes.plot(x, y, label=trace.name, color=trace.line.color, linewidth=width)
            axes.set_ylabel(_title(layout, f"yaxis{name}"))
        column[-1].set_xlabel(_title(layout, f"xaxis{panels[-1]}") or _title(layout, "xaxis"))
        drawn.legend(*column[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        buffer = io.BytesIO()
        drawn.savefig(buffer, dpi=_PIXELS)
    small = io.BytesIO()
    Image.open(buffer).quantize(_COLOURS).save(small, "PNG", optimize=True)
    return small.getvalue()


def _axis(name: str | None) -> str:
    """The number of an axis, "" for the first."""
    return (name or "")[1:]


def _is_left(layout: dict[str, Any], trace: Any) -> bool:
    return layout.get(f"xaxis{_axis(trace.xaxis)}", {}).get("domain", (0.0,))[0] == 0.0


def _numbers(values: Any) -> np.ndarray:
    """The values of a trace, which plotly may keep as the bytes of an array."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), dtype=values["dtype"])
    return np.array(values, dtype=float)


def _title(layout: dict[str, Any], axis: str) -> str:
    return str(layout.get(axis, {}).get("title", {}).get("text", "")).replace("<br>", "\n")


def main() -> None:
    """Executes the notebooks named on the command line in a temporary folder, and writes them back."""
    for name in sys.argv[1:] or sorted(path.stem for path in EXAMPLES.glob("*.ipynb")):
        path = EXAMPLES / f"{name}.ipynb"
        notebook = json.loads(path.read_text(encoding="utf-8"))
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            done = executed(notebook)
            os.chdir(EXAMPLES)
        path.write_text(json.dumps(done, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
