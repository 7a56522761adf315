"""The packages of `twin` import one way: each from those below it, and no two modules from one another."""

import ast
from pathlib import Path

import pytest
from paths import ROOT

PACKAGE = ROOT / "twin"

LAYERS = (
    {"errors"},
    {"foreign"},
    {"recording", "parameters", "correlations", "progress"},
    {"labels"},
    {"terminal"},
    {"files"},
    {"executors"},
    {"mechanics"},
    {"effects"},
    {"rigs"},
    {"campaigns"},
    {"proposal"},
    {"residuals"},
    {"estimation"},
    {"control", "diagnosis"},
    {"report", "export"},
    {"identification", "validation", "fleet"},
    {"api"},
    {"", "commands"},
    {"cli"},
)
"""Packages and modules directly in `twin`, lowest first; "" is `twin` itself, the public interface."""

ALONE = {"virtual_rig"}
"""Imports nothing of the twin but `SHARED`, which is no model, so that data made with it judge the twin fairly."""

SHARED = ("twin.errors", "twin.terminal", "twin.files.compiled", "twin.files.whole")


def imported(path: Path) -> set[tuple[int, str]]:
    """Line and dotted name of every module of `twin` that a file imports, at any depth of its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {(node.lineno, a.name) for a in node.names if a.name.split(".")[0] == "twin"}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "twin":
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add((node.lineno, whole if is_module(whole) else str(node.module)))
    return found


def is_module(name: str) -> bool:
    path = PACKAGE.joinpath(*name.split(".")[1:])
    return path.with_suffix(".py").exists() or (path / "__init__.py").exists()


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def layer_of(module: str) -> int:
    place = module.split(".")[1] if "." in module else ""
    return next(k for k, names in enumerate(LAYERS) if place in names)


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_point_down(path):
    module = module_of(path)
    place = module.split(".")[1] if "." in module else ""
    for line, target in imported(path):
        other = target.split(".")[1] if "." in target else ""
        if place == other:
            continue
        if place in ALONE:
            assert target in SHARED, f"{path}:{line}: {module} imports {target}; expected one of {SHARED}"
        elif other in ALONE:
            assert place == "commands", (
                f"{path}:{line}: {module} imports {target}; expected commands alone to"
            )
        else:
            down = layer_of(target) < layer_of(module)
            assert down, f"{path}:{line}: {module} imports {target}, which does not lie below it"


def test_no_module_imports_itself_by_way_of_others():
    edges = {module_of(p): {target for _, target in imported(p)} for p in FILES}
    done: set[str] = set()

    def visit(module: str, way: tuple[str, ...]) -> None:
        if module in way:
            pytest.fail(" -> ".join((*way[way.index(module) :], module)))
        if module not in done:
            for target in sorted(edges.get(module, ())):
                visit(target, (*way, module))
            done.add(module)

    for module in sorted(edges):
        visit(module, ())


def test_root_holds_a_handful_of_modules():
    assert len(list(PACKAGE.glob("*.py"))) <= 10
