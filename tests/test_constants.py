"""Numbers on which a verdict hangs are counted, so that they do not grow again: each is one more thing to justify."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from paths import ROOT

PACKAGES = ("diagnosis", "estimation", "residuals")
AFTER_THE_VERDICT = {
    "diagnosis/answer.py": "what is drawn",
    "diagnosis/budget_text.py": "words",
    "diagnosis/detectable.py": "what recordings could show",
    "diagnosis/experiments.py": "what to record next",
    "diagnosis/notes.py": "words",
    "diagnosis/plan.py": "what to record next",
    "diagnosis/separation.py": "what to record next",
    "diagnosis/traces.py": "what is drawn",
    "residuals/cache.py": "memory",
}
"""Modules that no verdict depends on."""
PLAIN = {-1, 0, 0.5, 1, 2, 3, 4}
"""Numbers that are part of a formula or an index more often than a choice."""


def on_the_path() -> Iterator[tuple[str, ast.Module]]:
    for package in PACKAGES:
        for path in sorted((ROOT / "twin" / package).glob("*.py")):
            name = f"{package}/{path.name}"
            if name not in AFTER_THE_VERDICT:
                yield name, ast.parse(path.read_text(encoding="utf-8"))


def numbers(node: ast.AST) -> list[float]:
    constants = [n.value for n in ast.walk(node) if isinstance(n, ast.Constant)]
    return [v for v in constants if isinstance(v, int | float) and not isinstance(v, bool)]


def named(tree: ast.Module) -> Iterator[str]:
    """Names that a module gives to numbers; a table of rules, each with a limit of its own, is none."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and numbers(node.value):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if not any(isinstance(n, ast.Lambda) for n in ast.walk(node.value)):
                yield from (n.id for n in ast.walk(target) if isinstance(n, ast.Name))


def inline(tree: ast.Module) -> list[float]:
    functions = [n for n in tree.body if not isinstance(n, ast.Assign | ast.AnnAssign)]
    return [v for n in functions for v in numbers(n) if v not in PLAIN]


@pytest.mark.parametrize(("count", "most"), [(named, 110), (inline, 49)])
def test_numbers_on_the_path_of_a_verdict_do_not_grow(count, most):
    found = {name: len(list(count(tree))) for name, tree in on_the_path()}
    assert sum(found.values()) <= most, found


@pytest.mark.parametrize("name", AFTER_THE_VERDICT)
def test_a_module_that_is_left_out_exists(name):
    assert Path(ROOT, "twin", name).exists()
