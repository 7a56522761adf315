"""Controllers from users' files, FILE.py:NAME.

NAME may be
- a factory, a function or a class whose parameters are named `rig` and `period` (both, one, or none of them),
  that returns any of the following;
- an object with `torque(measured, reference)` and, if it has states, `reset()`;
- a function `law(measured, reference)`;
- a python-control system with one input, hub angle's error [rad], and one output, torque [N m].
"""

from __future__ import annotations

import importlib.util
import inspect
import math
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from twin.control.laws.base import Controller, LinearController
from twin.errors import InputError, nearest

_GIVEN = ("rig", "period")  # names of parameters that a factory may have


class UserController:
    """A user's controller as a `Controller`; errors inside it are reported with file and line."""

    def __init__(
        self, law: Callable[..., Any], reset: Callable[[], Any] | None, owner: Any, file: Path
    ) -> None:
        """Takes the law, its reset function or None, the object to which both belong, and its file."""
        self._law, self._reset, self._owner, self._file = law, reset, owner, file

    @property
    def states(self) -> Mapping[str, float]:
        """States that the user's object reports; InputError where they are no mapping to numbers."""
        states = _guarded(self._file, getattr, self._owner, "states", {})
        try:
            return {str(name): float(value) for name, value in states.items()}
        except (AttributeError, TypeError, ValueError):
            raise InputError(
                f"{self._file}: states is {states!r}; expected a dict from names to numbers"
            ) from None

    def reset(self) -> None:
        """Resets the user's object, if it has a `reset`."""
        if self._reset is not None:
            _guarded(self._file, self._reset)

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`.

        Raises:
          InputError: the user's code fails, or returns no finite number.
        """
        answer = _guarded(self._file, self._law, measured, reference)
        try:
            value = float(answer)
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise InputError(
                f"{self._file}: at {measured['time']:.4g} s the controller returned {answer!r}; "
                f"expected a torque [N m], a finite number"
            )
        return value


def load(file: Path, name: str, rig: Mapping[str, float], period: float) -> Controller:
    """Returns the controller called `name` of a Python file, or the one that its factory of this name returns.

    Args:
      file: the Python file; it is executed.
      name: a name in it.
      rig, period: for a factory: parameters of the rig, sample period [s].

    Raises:
      InputError: the file cannot be run, or has no such name, or that is no controller.
    """
    module = _module(file)
    if not hasattr(module, name):
        known = [
            n for n, value in vars(module).items() if not n.startswith("_") and not inspect.ismodule(value)
        ]
        raise InputError(
            f"{file}: has no '{name}'; it has: {', '.join(known) or 'nothing'}{nearest(name, known)}"
        )
    thing = getattr(module, name)
    if not _is_system(thing) and _is_factory(thing):
        given = dict(zip(_GIVEN, (rig, period), strict=True))
        wanted = {key: given[key] for key in inspect.signature(thing).parameters if key in given}
        thing = _guarded(file, thing, **wanted)
    return _adapted(thing, file, name, period)


def _is_system(thing: Any) -> bool:
    import control

    return isinstance(thing, control.InputOutputSystem)


def _is_factory(thing: Any) -> bool:
    if not callable(thing):
        return False
    try:
        parameters = set(inspect.signature(thing).parameters)
    except (TypeError, ValueError):
        return False
    return inspect.isclass(thing) or parameters <= set(_GIVEN)


def _adapted(thing: Any, file: Path, name: str, period: float) -> Controller:
    import control

    if isinstance(thing, control.StateSpace | control.TransferFunction):
        return LinearController(_sampled(thing, file, name, period))
    if _is_system(thing):
        raise InputError(
            f"{file}: '{name}' is a python-control {type(thing).__name__}; expected a linear one, "
            "by control.tf or control.ss"
        )
    law = getattr(thing, "torque", thing)
    if not callable(law):
        raise InputError(
            f"{file}: '{name}' is {type(thing).__name__}; expected an object with torque(measured, reference), "
            "a function of these two, or a python-control system"
        )
    try:
        inspect.signature(law).bind({}, 0.0)
    except TypeError as error:
        raise InputError(f"{file}: '{name}' takes no (measured, reference): {error}") from None
    return UserController(law, getattr(thing, "reset", None), thing, file)


def _sampled(system: Any, file: Path, name: str, period: float):
    """Returns a system in discrete time with the sample period [s], by Tustin's rule if it was continuous."""
    import control

    if system.ninputs != 1 or system.noutputs != 1:
        raise InputError(
            f"{file}: '{name}' has {system.ninputs} inputs and {system.noutputs} outputs; "
            "expected one of each: hub angle's error [rad] in, torque [N m] out"
        )
    continuous = system.isctime(strict=True) or system.dt is None
    if not continuous and system.dt is not True and not math.isclose(system.dt, period, rel_tol=1e-6):
        raise InputError(f"{file}: '{name}' has a sample period of {system.dt:g} s; expected {period:g} s")
    try:
        states = control.ss(system)
    except ValueError as error:
        raise InputError(
            f"{file}: '{name}': {error}; expected no more zeros than poles, since a torque cannot depend on what comes"
        ) from None
    return control.ss(control.sample_system(states, period, "bilinear")) if continuous else states


def _module(file: Path) -> ModuleType:
    if not file.is_file():
        raise InputError(f"{file}: no such file; expected a Python file with a controller")
    spec = importlib.util.spec_from_file_location(f"controller_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: cannot be run; expected a Python file")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and pickle look a class up in its module.
    sys.modules[spec.name] = module
    _guarded(file, spec.loader.exec_module, module)
    return module


def _guarded(file: Path, function: Callable[..., Any], *given: Any, **named: Any) -> Any:
    """Calls a user's code; an exception becomes an InputError of one line with the line number."""
    try:
        return function(*given, **named)
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(f"{file}: line {error.lineno}: {error.msg}") from None
    except Exception as error:
        lines = [
            f
            for f in traceback.extract_tb(error.__traceback__)
            if Path(f.filename).resolve() == file.resolve()
        ]
        where = f"line {lines[-1].lineno}: " if lines else ""
        raise InputError(f"{file}: {where}{type(error).__name__}: {error}") from None
