"""Controllers from users' files, FILE.py:NAME.

NAME may be
- a factory, a function or a class whose parameters are named `rig` and `period` (both, one, or none of them),
  that returns any of the following;
- an object with `torque(measured, reference)` and, if it has states, `reset()`;
- a function `law(measured, reference)`;
- a python-control system with one input, hub angle's error [rad], and one output, torque [N m].

Each reset makes the controller anew from the file, so that a run depends on none before it, whatever state the user's
code keeps, and where.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from twin.control.laws.base import Controller, LinearController
from twin.control.laws.user_file import UserFile
from twin.errors import LARGEST, InputError, nearest
from twin.foreign import shown

MOST_STATES = 1000
"""Largest number of states: each is a column of a file."""
_GIVEN = ("rig", "period")  # names of parameters that a factory may have
_MISSING = object()


@dataclass(frozen=True)
class _Law:
    """What a user's object offers.

    Attributes:
      torque: (measured, reference) -> torque [N m].
      reset: called before a run; None where there is none.
      owner: the object, which may have `states`.
    """

    torque: Callable[..., Any]
    reset: Callable[[], Any] | None
    owner: Any


class UserController:
    """A user's controller as a `Controller`; errors inside it are reported with file and line."""

    def __init__(self, file: UserFile, make: Callable[[], _Law]) -> None:
        """Takes the file and a function that makes the user's object from it."""
        self._file, self._make = file, make
        self._law, self._used, self._time = make(), False, 0.0

    @property
    def states(self) -> Mapping[str, float]:
        """States that the user's object reports now; NaN where it reports that one is unknown.

        Raises:
          InputError: they are no mapping from names to numbers.
        """
        pairs = self._file.run(_pairs, self._law.owner)
        if isinstance(pairs, str):
            raise InputError(f"{self._file}: states is {pairs}; expected a dict from names to numbers")
        if len(pairs) > MOST_STATES:
            raise InputError(f"{self._file}: there are more than {MOST_STATES} states; expected fewer")
        states: dict[str, float] = {}
        for name, value in pairs:
            self._check_state(name, value, states)
            states[name] = value
        return states

    def _check_state(self, name: str, value: float, others: Mapping[str, float]) -> None:
        """Raises InputError where a state has a name that is no column of a file, or an infinite value."""
        if name in others:
            raise InputError(f"{self._file}: two states are called {name!r}; expected a name for each")
        if not name.isprintable() or name != name.strip() or not name:
            raise InputError(
                f"{self._file}: the name of a state is {shown(name)}; expected printable characters, "
                "no blank first or last"
            )
        if abs(value) > LARGEST:
            raise InputError(
                f"{self._file}: at {self._time:.4g} s the state {shown(name)} is {value:g}; "
                f"expected a number up to {LARGEST:g}, or nan where it is not known"
            )

    def reset(self) -> None:
        """Makes the user's object anew if it has been used, and resets it if it has a `reset`."""
        if self._used:
            self._law = self._make()
        self._used, self._time = True, 0.0
        if self._law.reset is not None:
            self._file.run(self._law.reset)

    def torque(self, measured: Mapping[str, float], reference: float) -> float:
        """Returns the torque [N m]; see `Controller`.

        Raises:
          InputError: the user's code fails, or returns no finite number.
        """
        self._used, self._time = True, measured.get("time", math.nan)  # before the law can change `measured`
        value, answer = self._file.run(_answer, self._law.torque, measured, reference)
        if not abs(value) <= LARGEST:
            raise InputError(
                f"{self._file}: at {self._time:.4g} s the controller returned {shown(answer)}; "
                f"expected a torque [N·m], a finite number up to {LARGEST:g}"
            )
        return value


# What runs inside the guard of the user's file: it touches the user's objects.


def _answer(law: Callable[..., Any], measured: Mapping[str, float], reference: float) -> tuple[float, Any]:
    """Returns the torque [N m], NaN where it is no real number, and what the law returned."""
    answer = law(measured, reference)
    value = None if isinstance(answer, bool | np.bool_) else _number(answer)
    return (math.nan if value is None else value), answer


def _pairs(owner: Any) -> list[tuple[str, float]] | str:
    """Returns names and values of the states that an object reports, or as a text what it reports instead."""
    states = _attribute(owner, "states", {})
    items = _attribute(states, "items", None)
    if not callable(items):
        return shown(states)
    numbers = [(str(name), _number(value)) for name, value in islice(items(), MOST_STATES + 1)]
    pairs = [(name, number) for name, number in numbers if number is not None]
    return pairs if len(pairs) == len(numbers) else shown(states)


def _number(value: Any) -> float | None:
    """Returns a real number as a float, infinite where it is larger than one; None for anything else."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, str | bytes | bytearray | np.complexfloating):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        return None


def _attribute(owner: Any, name: str, default: Any) -> Any:
    """Returns an attribute, or `default` where there is none; an AttributeError inside a property is raised."""
    value = getattr(owner, name, _MISSING)
    if value is _MISSING:
        there = inspect.getattr_static(owner, name, _MISSING) is not _MISSING
        return getattr(owner, name) if there else default
    return value


def load(path: Path, name: str, rig: Mapping[str, float], period: float) -> Controller:
    """Returns the controller called `name` of a Python file, or the one that its factory of this name returns.

    Args:
      path: the Python file; it is executed with the rights of this process.
      name: a name in it.
      rig, period: for a factory: parameters of the rig, sample period [s].

    Raises:
      InputError: the file cannot be run, or has no such name, or that is no controller.
    """
    file = UserFile(path)
    return UserController(file, lambda: file.run(_made, file, name, rig, period))


def _made(file: UserFile, name: str, rig: Mapping[str, float], period: float) -> _Law:
    """Executes the file and returns what `name` in it is, or makes."""
    with warnings.catch_warnings():  # filters that the file sets are not for the rest of the process
        module = file.execute()
        if not hasattr(module, name):
            known = [
                n
                for n, value in vars(module).items()
                if not n.startswith("_") and not inspect.ismodule(value)
            ]
            raise InputError(
                f"{file}: has no '{name}'; it has: {', '.join(known) or 'nothing'}{nearest(name, known)}"
            )
        thing = getattr(module, name)
        if not _is_system(thing) and _is_factory(thing):
            given = dict(zip(_GIVEN, (rig, period), strict=True))
            thing = thing(**{key: given[key] for key in inspect.signature(thing).parameters if key in given})
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


def _adapted(thing: Any, file: UserFile, name: str, period: float) -> _Law:
    import control

    if isinstance(thing, control.StateSpace | control.TransferFunction):
        linear = LinearController(_sampled(thing, file, name, period))
        return _Law(linear.torque, linear.reset, linear)
    if _is_system(thing):
        raise InputError(
            f"{file}: '{name}' is a python-control {type(thing).__name__}; expected a linear one, "
            "by control.tf or control.ss"
        )
    law = _attribute(thing, "torque", thing)
    if not callable(law):
        raise InputError(
            f"{file}: '{name}' is {type(thing).__name__}; expected an object with torque(measured, reference), "
            "a function of these two, or a python-control system"
        )
    try:
        inspect.signature(law).bind({}, 0.0)
    except TypeError as error:
        raise InputError(f"{file}: '{name}' takes no (measured, reference): {error}") from None
    return _Law(law, _attribute(thing, "reset", None), thing)


def _sampled(system: Any, file: UserFile, name: str, period: float):
    """Returns a system in discrete time with the sample period [s], by Tustin's rule if it was continuous."""
    import control

    if system.ninputs != 1 or system.noutputs != 1:
        raise InputError(
            f"{file}: '{name}' has {system.ninputs} inputs and {system.noutputs} outputs; "
            "expected one of each: hub angle's error [rad] in, torque [N·m] out"
        )
    continuous = system.isctime(strict=True) or system.dt is None
    if not continuous and system.dt is not True and not math.isclose(system.dt, period, rel_tol=1e-6):
        raise InputError(f"{file}: '{name}' has a sample period of {system.dt:g} s; expected {period:g} s")
    _check_finite(system, f"{file}: '{name}'")
    try:
        states = control.ss(system)
    except ValueError as error:
        raise InputError(
            f"{file}: '{name}': {error}; expected no more zeros than poles, since a torque cannot depend on what comes"
        ) from None
    return _by_tustin(states, period, f"{file}: '{name}'") if continuous else states


def _by_tustin(system: Any, period: float, where: str):
    """Returns a continuous system in discrete time.

    z = (1 + s T/2) / (1 - s T/2) is infinite at s = 2/T: a pole there has no image.
    """
    import control

    try:
        sampled = control.sample_system(system, period, "bilinear")
    except np.linalg.LinAlgError:
        raise InputError(
            f"{where} has a pole at 2/T = {2 / period:g} 1/s, where Tustin's rule is singular; expected another pole, "
            "or a system in discrete time"
        ) from None
    _check_finite(sampled, f"{where} in discrete time")
    return control.ss(sampled)


def _check_finite(system: Any, where: str) -> None:
    """Raises InputError where a coefficient of a system with one input and one output is not finite."""
    import control

    coefficients: tuple[Any, ...]
    if isinstance(system, control.TransferFunction):
        coefficients = (system.num[0][0], system.den[0][0])
    else:
        coefficients = (system.A, system.B, system.C, system.D)
    if not all(np.all(np.isfinite(matrix)) for matrix in coefficients):
        raise InputError(f"{where} has a coefficient that is not finite; expected numbers")
