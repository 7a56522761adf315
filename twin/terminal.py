"""Standard output and standard error: what they cannot show is replaced, what they lose is told, and signals end both.

Imports nothing heavy, as every command begins with it.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn, TextIO

from twin.errors import InputError

BAD_INPUT = 2
"""Exit code where an input cannot be used or an output cannot be written."""
INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of the signal, as shells have it."""
TERMINATED = 143
"""Exit code after SIGTERM."""
READER_GONE = 141
"""Exit code where the reader of the output has gone, as in `twin check | head -1`: that of SIGPIPE."""


class OutputLost(Exception):
    """Standard output could not be written.

    Attributes:
      reason: why; None where its reader has gone.
    """

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        self.reason = None if isinstance(error, BrokenPipeError) else error.strerror or str(error)


def run(command: Callable[[], int | None]) -> NoReturn:
    """Runs a command and exits with the code that it returns, or with that of its error or signal, told in one line."""
    _prepare()
    try:
        code = _exit_code(command)
        _flush()
    except OutputLost as lost:
        code = _report_lost_output(lost)
    sys.exit(code)


def _exit_code(command: Callable[[], int | None]) -> int | str | None:
    """Runs a command; returns its exit code.

    Raises:
      OutputLost: standard output cannot be written.
    """
    try:
        return command()
    except InputError as error:
        report_error(str(error))
        return BAD_INPUT
    except OSError as error:
        _flush()  # raises, if this is what failed
        if isinstance(error, BrokenPipeError):
            raise OutputLost(error) from error
        place = error.filename or "standard output or a file"  # not known for a print without a buffer
        report_error(f"cannot use {place}: {error.strerror or error}")
        return BAD_INPUT
    except KeyboardInterrupt:
        code: int | str | None = INTERRUPTED
    except SystemExit as end:  # with 130, in silence, where typer caught the interrupt
        code = end.code
    _report_end(code)
    return code


def _prepare() -> None:
    """Makes the streams of the process usable, and signals end it by an exception, so that it cleans up."""
    _open_closed_descriptors()
    if sys.stdout is None:
        sys.stdout = _text_stream(1)
    if sys.stderr is None:
        sys.stderr = _text_stream(2)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace" if stream is sys.stdout else "backslashreplace")
    warnings.showwarning = _show_warning  # type: ignore[assignment]
    for name in ("SIGTERM", "SIGHUP"):  # the latter is not known to Windows
        number = getattr(signal, name, None)
        # Whoever started the process may have it ignore a signal, as nohup does.
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)


def _flush() -> None:
    """Writes what is still in the buffer of standard output.

    Raises:
      OutputLost: it cannot be written.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        raise OutputLost(error) from error


def _report_lost_output(lost: OutputLost) -> int:
    """Says that output is lost, unless its reader has gone; returns the exit code."""
    # What is still in the buffer must not be written again when the interpreter ends.
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if lost.reason is None:
        return READER_GONE
    report_error(f"cannot write to standard output: {lost.reason}")
    return BAD_INPUT


def report_error(message: str) -> None:
    """Prints an error on standard error, in ASCII where that knows nothing else."""
    from twin.labels import printable  # 0.1 s

    plain = not (sys.stderr.encoding or "").lower().startswith("utf")
    with suppress(OSError):
        print(f"Error: {printable(message, plain)}", file=sys.stderr, flush=True)


def _report_end(code: int | str | None) -> None:
    """Says in one line which signal ended a command, where its exit code tells."""
    said = (
        {INTERRUPTED: "Interrupted.", TERMINATED: "Terminated."}.get(code) if isinstance(code, int) else None
    )
    if said:
        with suppress(OSError):
            print(said, file=sys.stderr, flush=True)


def _show_warning(message: Warning | str, *_: Any) -> None:
    """Prints a warning without the line of code that gave it."""
    with suppress(OSError):
        print(f"Warning: {message}", file=sys.stderr, flush=True)


def _open_closed_descriptors() -> None:
    """Opens descriptors 0 to 2 where they are closed: else the next file that is opened takes their place.

    Reading is all that they allow, so that writing fails, as it does on a closed descriptor.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY), True)


def _text_stream(number: int) -> TextIO:
    return open(number, "w", encoding="utf-8", closefd=False)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    signal.signal(number, signal.SIG_DFL)  # a second one ends at once
    raise SystemExit(128 + number)
