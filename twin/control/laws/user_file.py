"""A Python file of a user, which is executed, and whose neighbours it can import."""

from __future__ import annotations

import inspect
import os
import sys
import traceback
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from twin import foreign
from twin.errors import InputError

_OTHERS = {*sys.stdlib_module_names, "twin", "control", "numpy", "scipy"}
"""Modules that no file beside a controller replaces: a `control.py` there is often the controller itself."""


class _Beside:
    """Finds the modules in a folder before any others of their names, as Python does for a script."""

    def __init__(self, folder: str, names: Collection[str]) -> None:
        self._folder, self._names = folder, names

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [self._folder]) if name in self._names else None


class UserFile:
    """A user's Python file, read once.

    The modules beside it can be imported while its code runs, at any time. They belong to this object alone: files in
    other folders have other modules of the same names.
    """

    def __init__(self, path: Path) -> None:
        """Reads the file.

        Raises:
          InputError: it cannot be read, or is no Python.
        """
        self._path, self._name = path, f"controller_{path.stem.replace('.', '_')}"
        source = _source(path)
        folder = os.path.dirname(os.path.realpath(path))
        with foreign.guarded(self._told):
            self._code = compile(source, str(path), "exec", dont_inherit=True)
            self._names = frozenset(_modules_in(folder)) - _OTHERS - {path.stem}
        self._finder = _Beside(folder, self._names)
        self._modules: dict[str, ModuleType] = {}

    def __str__(self) -> str:
        return str(self._path)

    def execute(self) -> ModuleType:
        """Executes the file and returns its module, a new one each time, as are the modules beside it.

        To be called by `run`.
        """
        for name in self._own():
            del sys.modules[name]
        self._modules = {}
        module = ModuleType(self._name)
        module.__file__ = os.path.abspath(self._path)
        # Dataclasses look a class up in its module.
        sys.modules[self._name] = module
        exec(self._code, vars(module))
        return module

    def run(self, function: Callable[..., Any], *given: Any) -> Any:
        """Returns what a function of the file returns.

        Raises:
          InputError: it fails; names the file, and the line where there is one.
        """
        with foreign.guarded(self._told), self._importable():
            return function(*given)

    @contextmanager
    def _importable(self) -> Iterator[None]:
        """Lets the modules beside the file be imported, and puts modules of other folders aside."""
        others = {name: sys.modules.pop(name) for name in self._own()}
        sys.modules.update(self._modules)
        loaded = len(sys.modules)
        finders = sys.meta_path
        sys.meta_path = [self._finder, *finders]
        try:
            yield
        finally:
            sys.meta_path = finders
            if len(sys.modules) != loaded or not self._modules:
                self._modules = {name: sys.modules[name] for name in self._own()}
            for name in self._modules:
                sys.modules.pop(name, None)
            sys.modules.update(others)

    def _own(self) -> list[str]:
        """Names of the loaded modules that have a name of this file's own."""
        own = {name for name in (*self._names, self._name) if name in sys.modules}
        return [name for name in sys.modules if name.partition(".")[0] in own] if own else []

    def _told(self, error: BaseException) -> InputError:
        if isinstance(error, SyntaxError) and error.filename == str(self._path):
            return InputError(f"{self}: line {error.lineno}: {error.msg}")
        frames = traceback.walk_tb(error.__traceback__)
        lines = [line for frame, line in frames if frame.f_code.co_filename == str(self._path)]
        where = f"line {lines[-1]}: " if lines else ""
        return InputError(f"{self}: {where}{foreign.described(error)}")


def _source(path: Path) -> bytes:
    """Returns the content of a file; raises InputError where it cannot be read."""
    try:
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "no regular file"
            raise InputError(f"{path} is {kind}; expected a Python file with a controller")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected a Python file with a controller") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _modules_in(folder: str) -> Iterator[str]:
    """Yields the names of the modules and packages in a folder."""
    for entry in os.scandir(folder):
        package = entry.is_dir() and any(Path(entry.path).glob("*.py"))
        name = entry.name if package else inspect.getmodulename(entry.name)
        if name and name.isidentifier():
            yield name
