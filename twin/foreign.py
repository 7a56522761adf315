"""Code of others, a user's controller or an effect of another package: it cannot decide how a command ends.

Whatever it raises becomes a message. What it changes in the process is put back: working directory, `sys.path`, output
streams, numpy's handling of floating-point errors. What it prints goes to standard error, apart from results.
"""

from __future__ import annotations

import dis
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, NoReturn

import numpy as np

from twin.errors import InputError

_LONGEST = 200  # characters of a text of foreign code that a message shows


class _ProcessEnd(BaseException):
    """Foreign code called `os._exit`, which would end the process with an exit code of its own."""


@contextmanager
def guarded(tell: Callable[[BaseException], InputError]) -> Iterator[None]:
    """Context in which foreign code runs: whatever it raises is raised as `tell(error)`.

    An InputError passes as it is, and so does what ends the process from outside, see `from_outside`.
    """
    with _process_kept():
        try:
            yield
        except BaseException as error:
            if type(error) is InputError or from_outside(error):
                raise
            raise tell(error) from None


def from_outside(error: BaseException) -> bool:
    """Whether Ctrl-C, or another signal that ends the process, raised an error, and not the code in which it arrived.

    Python's handler of Ctrl-C raises KeyboardInterrupt between two instructions, foreign code by the instruction
    `raise`. Handlers of other signals are functions of this package that raise SystemExit.
    """
    if error.__traceback__ is None or not isinstance(error, KeyboardInterrupt | SystemExit):
        return False
    origin = _origin(error.__traceback__)
    code = origin.tb_frame.f_code
    if isinstance(error, KeyboardInterrupt):
        return dis.opname[code.co_code[origin.tb_lasti]] != "RAISE_VARARGS"
    return str(origin.tb_frame.f_globals.get("__name__")).startswith("twin.")


def _origin(trace: TracebackType) -> TracebackType:
    """The innermost frame."""
    while trace.tb_next is not None:
        trace = trace.tb_next
    return trace


def described(error: BaseException) -> str:
    """Returns kind and text of an error in one line; it need not have a text."""
    if isinstance(error, SystemExit | _ProcessEnd):
        return f"it ends the program, with exit code {shown(error.args[0] if error.args else None)}"
    text = _text(str, error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def reason(error: BaseException) -> str:
    """Returns the text of an error in one line; with its kind where the text is a single word, or missing."""
    text = _text(str, error)
    return text if " " in text else described(error)


def shown(value: Any) -> str:
    """Returns a value of foreign code as Python writes it, in one line of bounded length."""
    return _text(repr, value) or f"an object of {type(value).__name__}"


def _text(function: Callable[[Any], str], value: Any) -> str:
    """Returns str or repr of an object in one line; "" where it has none."""
    try:
        text = function(value)
    except BaseException as error:
        if from_outside(error):
            raise
        return ""
    line = " ".join("".join(c if c.isprintable() else " " for c in text[: 2 * _LONGEST]).split())
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]}..."


@contextmanager
def _process_kept() -> Iterator[None]:
    """Puts back what foreign code may change in the process."""
    folder, path, places, streams = _working_folder(), sys.path, list(sys.path), (sys.stdout, sys.stderr)
    ends, os._exit = os._exit, _refused(os._exit)  # type: ignore[assignment]
    sys.stdout = sys.stderr
    try:
        with np.errstate():
            yield
    finally:
        os._exit = ends
        sys.path, (sys.stdout, sys.stderr) = path, streams
        sys.path[:] = places
        if folder is not None and folder != _working_folder():
            os.chdir(folder)


def _working_folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it has been removed
        return None


def _refused(ends: Callable[[int], NoReturn]) -> Callable[[int], NoReturn]:
    """Returns an `os._exit` that raises where this thread calls it; other threads and forked processes end as ever."""
    process, thread = os.getpid(), threading.get_ident()

    def refuse(status: int) -> NoReturn:
        if (os.getpid(), threading.get_ident()) != (process, thread):
            ends(status)
        raise _ProcessEnd(status)

    return refuse
