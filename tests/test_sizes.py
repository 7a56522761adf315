"""Modules and functions stay small enough to be read at once."""

import ast

import numpy as np
from paths import ROOT

LONGEST_MODULE = 500
LONGEST_BODY, NINE_IN_TEN = 50, 16
COMPILED = {"mechanics/planar.py", "virtual_rig/plant.py"}
"""Equations of motion stay in one file each: the cache of the compiler does not see a change in another one."""

PACKAGE = ROOT / "twin"
FILES = [p for p in sorted(PACKAGE.rglob("*.py")) if str(p.relative_to(PACKAGE)) not in COMPILED]


def bodies():
    """Lines of each function's body, its docstring left out, with where it stands."""
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[1:] if ast.get_docstring(node) is not None else node.body
                lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
                yield lines, f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"


def test_modules_are_short():
    lengths = {str(p.relative_to(ROOT)): len(p.read_text(encoding="utf-8").splitlines()) for p in FILES}
    assert {name: n for name, n in lengths.items() if n > LONGEST_MODULE} == {}


def test_functions_are_short():
    found = list(bodies())
    assert [place for lines, place in found if lines > LONGEST_BODY] == []
    assert np.quantile([lines for lines, _ in found], 0.9) <= NINE_IN_TEN
