"""Code of others: what it raises is told, what it changes is put back, what ends the process from outside passes."""

import contextlib
import os
import re
import signal
import sys
import threading

import numpy as np
import pytest

from twin.errors import InputError
from twin.foreign import described, from_outside, guarded, shown


def tell(error):
    return InputError(f"told: {described(error)}")


class Mute(Exception):
    def __str__(self):
        raise SystemExit(0)

    __repr__ = __str__


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("no gain"), "told: ValueError: no gain"),
        (ValueError("two\nlines \x1b[31m"), "told: ValueError: two lines [31m"),
        (Mute(), "told: Mute"),
        (SystemExit(0), "told: it ends the program, with exit code 0"),
        (SystemExit(), "told: it ends the program, with exit code None"),
        (KeyboardInterrupt(), "told: KeyboardInterrupt"),
        (GeneratorExit(), "told: GeneratorExit"),
        (StopIteration(1), "told: StopIteration: 1"),
        (BaseException("x" * 1000), f"told: BaseException: {'x' * 200}..."),
    ],
)
def test_whatever_it_raises_is_told_in_one_line(error, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"), guarded(tell):
        raise error


def test_it_cannot_end_the_process():
    with pytest.raises(InputError, match="it ends the program, with exit code 0"), guarded(tell):
        os._exit(0)
    assert os._exit.__module__ == "posix"


def test_its_forked_processes_end_as_they_like():
    with guarded(tell):
        child = os.fork()
        if child == 0:
            os._exit(7)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


def test_other_threads_are_not_kept_from_ending_the_process(monkeypatch):
    ended = []
    monkeypatch.setattr(os, "_exit", ended.append)

    def end():
        with contextlib.suppress(BaseException):  # the real function does not return
            os._exit(3)

    with guarded(tell):
        # As a thread that watches the process that started this one.
        thread = threading.Thread(target=end)
        thread.start()
        thread.join()
    assert ended == [3]


@pytest.mark.parametrize("send", [signal.raise_signal, lambda number: os.kill(os.getpid(), number)])
def test_an_interrupt_from_the_keyboard_passes(send):
    with pytest.raises(KeyboardInterrupt), guarded(tell):
        send(signal.SIGINT)


def test_only_a_signal_comes_from_outside():
    assert not from_outside(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt) as raised:
        raise KeyboardInterrupt
    assert not from_outside(raised.value)
    with pytest.raises(SystemExit) as ended:
        sys.exit(143)
    assert not from_outside(ended.value)
    # As the handler of a signal in this package does.
    with pytest.raises(SystemExit) as handled:
        exec("raise SystemExit(143)", {"__name__": "twin.terminal"})
    assert from_outside(handled.value)


def test_what_it_changes_in_the_process_is_put_back(tmp_path, capsys):
    before = (os.getcwd(), sys.path, list(sys.path), sys.stdout, sys.stderr, np.geterr())
    with guarded(tell):
        print("a trace")
        os.chdir(tmp_path)
        sys.path.insert(0, "nowhere")
        sys.path = []
        sys.stdout = sys.stderr = None
        np.seterr(all="raise")
    assert (os.getcwd(), sys.path, list(sys.path), sys.stdout, sys.stderr, np.geterr()) == before
    assert capsys.readouterr() == ("", "a trace\n")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1 + 2j, "(1+2j)"),
        pytest.param(10**5000, "an object of int", id="huge"),
        (Mute(), "an object of Mute"),
        ([1, 2], "[1, 2]"),
    ],
)
def test_a_value_is_shown_in_one_line(value, text):
    assert shown(value) == text
    assert len(shown(10**400)) < 210
