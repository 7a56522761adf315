"""The ends of a command: lost output, signals and errors are one line and an exit code."""

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="descriptors and signals of POSIX")

_HEAD = "import os, signal, sys, time, warnings; from twin import terminal\n"


def run(command: str, close: tuple[int, ...] = (), **options) -> tuple[int, str, str]:
    """Runs a command of one line by `terminal.run`, some descriptors closed; returns exit code, output and errors."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in close:
            os.close(number)

    code = f"{_HEAD}def command():\n    {command}\nterminal.run(command)"
    environment = {**os.environ, "PYTHONUNBUFFERED": "", **options.pop("env", {})}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment, **options}
    done = subprocess.run([sys.executable, "-c", code], text=True, preexec_fn=prepare, timeout=60, **options)
    return done.returncode, done.stdout or "", done.stderr or ""


def test_output_and_exit_code_are_those_of_the_command():
    assert run("print(1); return 1") == (1, "1\n", "")
    assert run("print(1)") == (0, "1\n", "")


@pytest.mark.parametrize("printing", ["print(1)", "print(1, flush=True)"])
def test_output_that_is_lost_is_told(printing):
    with open("/dev/full", "w") as full:
        code, _, error = run(printing, stdout=full)
    assert (code, error) == (2, "Error: cannot write to standard output: No space left on device\n")
    code, _, error = run(printing, close=(1,))
    assert (code, error) == (2, "Error: cannot write to standard output: Bad file descriptor\n")


def test_closed_streams_that_are_not_needed_do_not_matter():
    assert run("pass", close=(0, 1)) == (0, "", "")
    assert run("print(1); print(2, file=sys.stderr)", close=(2,)) == (0, "1\n", "")
    assert run("print(1)", close=(1, 2)) == (2, "", "")


def test_no_file_takes_the_place_of_a_closed_stream():
    assert (
        run("return os.open('.', os.O_RDONLY) if os.open('.', os.O_RDONLY) > 2 else 0", close=(0, 1, 2))[0]
        > 2
    )


def test_output_without_a_buffer_is_lost_too():
    with open("/dev/full", "w") as full:
        code, _, error = run("print(1)", stdout=full, env={"PYTHONUNBUFFERED": "1"})
    assert (code, error) == (2, "Error: cannot use standard output or a file: No space left on device\n")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("printing", ["print(1)", "print(100000 * 'long')"])
def test_a_reader_that_has_gone_ends_it_in_silence(printing, unbuffered):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ended = run(printing, stdout=writing, env={"PYTHONUNBUFFERED": unbuffered})
        assert ended == (141, "", "")
    finally:
        os.close(writing)


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [("SIGINT", 130, "Interrupted.\n"), ("SIGTERM", 143, "Terminated.\n"), ("SIGHUP", 129, "")],
)
def test_a_signal_ends_it_in_one_line_after_it_has_cleaned_up(number, code, said):
    command = f"""
    try:
        os.kill(os.getpid(), signal.{number}); time.sleep(30)
    finally:
        print("cleaned up")"""
    assert run(command) == (code, "cleaned up\n", said)


def test_a_signal_that_is_ignored_stays_so():
    ignored = f"{_HEAD}signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    code = f"{ignored}terminal.run(lambda: os.kill(os.getpid(), signal.SIGHUP))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_errors_of_files_are_one_line():
    assert run("open('/no/such')") == (2, "", "Error: cannot use /no/such: No such file or directory\n")
    assert run("raise OSError(28, 'No space left on device')")[1:] == (
        "",
        "Error: cannot use standard output or a file: No space left on device\n",
    )


def test_warnings_are_one_line():
    assert run("warnings.warn('beware')") == (0, "", "Warning: beware\n")


def test_what_a_stream_cannot_encode_is_replaced():
    command = r"print('\u00b0'); raise terminal.InputError('\u00b5\x1b[31m')"
    assert run(command, env={"PYTHONIOENCODING": "ascii"}) == (2, "?\n", "Error: u\\x1b[31m\n")
