"""Broken inputs for every reader: each must be refused with one clear message, or give an object that is right.

    python benchmarks/fuzz.py [--inputs N] [--seed S] [--only K] [--out FILE]

Input k of a seed is always the same: one valid file is broken in one way (`fuzz_mutations`), its folder is given to
the product's reader (`fuzz_targets`) in a forked process with bounded time and memory. Faults are tracebacks, hangs,
memory, messages that are no help, objects that are wrong, and silence where nothing can be right. `--only K` shows one
input. Exit code 1 where there are faults.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import json
import math
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import IO
from unittest import mock

from fuzz_mutations import Kind
from fuzz_targets import Target, targets
from machine import command, describe
from threadpoolctl import threadpool_limits

from twin import cli
from twin.errors import InputError

PROCESSOR = 10  # s, processor time of one input
_WAIT = 5  # s, time that a process may sleep, for a file that never comes
MEMORY = 2**30  # bytes beyond those of the process that is forked
_LONGEST = 2000  # characters of a message
_SHOWN = 300  # characters of a message that are kept
_INPUTS_OF_A_CHILD = 20  # inputs that a process judges: forking takes longer than most of them
REFUSED, RIGHT = "refused", "right"
FAULTS = ("traceback", "hang", "memory", "message", "wrong object", "accepted")
"""Outcomes that are faults; `accepted` is silence where an input had to be refused."""


@dataclass(frozen=True)
class Broken:
    """One broken input: its number, its target and kind, and what is written in the file's place."""

    number: int
    target: Target
    kind: Kind
    place: Callable[[Path], None]


@dataclass(frozen=True)
class Outcome:
    """What became of an input: `REFUSED`, `RIGHT` or one of `FAULTS`, and the first line of what was said."""

    broken: Broken
    what: str
    said: str


# Inputs


def _as_folder(file: Path) -> None:
    file.mkdir()


def _as_link_to_itself(file: Path) -> None:
    file.symlink_to(file)


def _as_pipe(file: Path) -> None:
    os.mkfifo(file)


PLACES: tuple[tuple[str, Callable[[Path], None]], ...] = (
    ("file missing", lambda file: None),
    ("folder in the file's place", _as_folder),
    ("link to itself", _as_link_to_itself),
    ("pipe without writer", _as_pipe),
)
"""Kinds that put something else in the place of a file."""


def _nothing(content: bytes, rng: Random) -> bytes:
    return content


def kinds_of(target: Target) -> list[tuple[Kind, Callable[[Path], None] | None]]:
    """Returns all kinds of a target, with what they put in the file's place if that is no content."""
    # A campaign without static.csv is one without that test.
    apart = {"file missing": ("static",), "link to itself": ("static",)}
    places = [(Kind(name, _nothing, True, apart.get(name, ())), put) for name, put in PLACES]
    others = [t for t in targets() if t.file.rpartition(".")[2] != target.file.rpartition(".")[2]]
    swapped = [
        (Kind(f"{t.name} in its place", lambda c, r, t=t: t.files[t.file], True), None) for t in others
    ]
    return [*((kind, None) for kind in target.kinds), *places, *swapped]


def broken_input(seed: int, number: int) -> Broken:
    """Returns an input of a seed; targets and kinds take turns, so that all come."""
    target = targets()[number % len(targets())]
    kinds, turn = kinds_of(target), number // len(targets())
    Random(seed).shuffle(kinds)  # so that a few inputs show some of each group
    rng = Random(f"{seed} {number}")
    for k in range(len(kinds)):
        kind, put = kinds[(turn + k) % len(kinds)]
        if put is not None:
            return Broken(number, target, kind, put)
        content = kind.mutate(target.files[target.file], rng)
        if content is not None and content != target.files[target.file]:
            return Broken(number, target, kind, functools.partial(_write, content=content))
    raise ValueError(f"no kind applies to {target.name}")


def _write(file: Path, content: bytes) -> None:
    file.write_bytes(content)


def prepare(broken: Broken, folder: Path) -> None:
    """Writes the files of an input into a folder, which is made."""
    folder.mkdir(parents=True)
    for name, content in broken.target.files.items():
        if name != broken.target.file:
            (folder / name).write_bytes(content)
    broken.place(folder / broken.target.file)


# Judgement


def judged(broken: Broken, folder: Path) -> tuple[str, str]:
    """Reads an input; returns what became of it, and what was said."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            broken.target.read(folder)
        except InputError as error:
            raised: BaseException = error
        except AssertionError as error:
            return "wrong object", str(error)
        except MemoryError:
            return "memory", "MemoryError"
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            return "traceback", f"{type(error).__name__}: {error} ({Path(last.filename).name}, {last.name})"
        else:
            return ("accepted" if broken.kind.must_refuse(broken.target.name) else RIGHT), ""
    said = _printed(raised)
    flaw = _flaw(said, broken)
    return ("message", f"{flaw}: {said}") if flaw else (REFUSED, said)


def _printed(error: BaseException) -> str:
    """What the command line prints for an error."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), mock.patch.object(cli, "app", side_effect=error):
        try:
            cli.main()
        except SystemExit as stop:
            if stop.code != 2:
                return f"exit code {stop.code}"
    return said.getvalue().removesuffix("\n")


def _flaw(said: str, broken: Broken) -> str:
    """What is wrong with a message; "" if nothing is."""
    if not said.startswith("Error: "):
        return "no Error:"
    if len(said) > _LONGEST:
        return f"{len(said)} characters"
    if any(not (c.isprintable() or c == "\n") for c in said):
        return "control characters"
    names = (
        *broken.target.files,
        *re.findall(r"[a-z_]{4,}", broken.target.files[broken.target.file].decode()),
    )
    return "" if any(name in said for name in names) else "names neither file nor field"


# Processes


def outcomes(seed: int, numbers: Iterable[int]) -> list[Outcome]:
    """Returns what becomes of inputs of a seed, judged in forked processes with bounded time and memory."""
    inputs, found = [broken_input(seed, number) for number in numbers], []
    with tempfile.TemporaryDirectory() as work, threadpool_limits(1):
        for target in targets():  # compiles and caches what all processes share
            _check_valid(target, Path(work) / target.name)
        while len(found) < len(inputs):
            found += _judged_by_child(inputs[len(found) :][:_INPUTS_OF_A_CHILD], Path(work))
    return found


def _check_valid(target: Target, folder: Path) -> None:
    """Makes sure that the files of a target are accepted as long as nothing is broken."""
    put = functools.partial(_write, content=target.files[target.file])
    valid = Broken(-1, target, Kind("none", _nothing), put)
    prepare(valid, folder)
    what, said = judged(valid, folder)
    if what != RIGHT:
        raise AssertionError(f"the valid files of {target.name} are not accepted: {what}, {said}")


def _judged_by_child(inputs: Sequence[Broken], work: Path) -> list[Outcome]:
    """What becomes of inputs, up to the first that ends the process."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _in_child(inputs, work, writer)
    os.close(writer)
    found = []
    with os.fdopen(reader, "rb", buffering=0) as answers:
        while line := _answer(answers, child):
            what, said = json.loads(line)
            found.append(Outcome(inputs[len(found)], what, " ".join(said.split())))
    os.kill(child, signal.SIGKILL)  # one that waits; nothing happens to one that has ended
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if len(found) < len(inputs):
        slow = ended in (-signal.SIGXCPU, -signal.SIGKILL)
        what, said = ("hang", "time is over") if slow else ("traceback", f"the process ended with {ended}")
        found.append(Outcome(inputs[len(found)], what, said))
    return found


def _answer(answers: IO[bytes], child: int) -> bytes:
    """The next line that a process writes; empty where it has ended, or waits for what never comes."""
    waited = 0
    while waited < _WAIT:
        if select.select([answers], [], [], 1.0)[0]:
            return answers.readline()
        # After the name, which may hold anything, in brackets: S for one that sleeps.
        sleeps = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "S"
        waited = waited + 1 if sleeps else 0
    return b""


def _in_child(inputs: Sequence[Broken], work: Path, writer: int) -> None:
    """Judges inputs in the forked process, writes a line of JSON for each, and ends it."""
    try:
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        for broken in inputs:
            spent = resource.getrusage(resource.RUSAGE_SELF)
            allowed = math.ceil(spent.ru_utime + spent.ru_stime) + PROCESSOR
            resource.setrlimit(resource.RLIMIT_CPU, (allowed, resource.RLIM_INFINITY))
            folder = work / str(broken.number)
            prepare(broken, folder)
            os.chdir(folder)
            os.write(writer, json.dumps(_short(*judged(broken, folder))).encode() + b"\n")
            shutil.rmtree(folder)
    finally:
        os._exit(0)


def _short(what: str, said: str) -> tuple[str, str]:
    return what, said[:_SHOWN]


# Report


def table(found: Sequence[Outcome]) -> list[str]:
    """Returns lines of Markdown: outcomes by target, and each distinct fault with an input that shows it."""
    heads = (REFUSED, RIGHT, *FAULTS)
    lines = [f"| input | kinds | inputs | {' | '.join(heads)} |", f"| --- |{' ---: |' * (len(heads) + 2)}"]
    for target in targets():
        own = [o for o in found if o.broken.target.name == target.name]
        count = Counter(o.what for o in own)
        kinds = len({o.broken.kind.name for o in own})
        lines.append(f"| {target.name} | {kinds} | {len(own)} | {' | '.join(str(count[h]) for h in heads)} |")
    total = Counter(o.what for o in found)
    kinds = len({o.broken.kind.name for o in found})
    lines.append(f"| all | {kinds} | {len(found)} | {' | '.join(str(total[h]) for h in heads)} |")
    return lines + _faults(found)


def _faults(found: Sequence[Outcome]) -> list[str]:
    faults = [o for o in found if o.what in FAULTS]
    if not faults:
        return ["", "No faults."]
    groups: dict[tuple[str, str, str], list[Outcome]] = {}
    for o in faults:
        groups.setdefault((o.broken.target.name, o.broken.kind.name, o.what), []).append(o)
    lines = [
        "",
        "| input | kind | fault | times | `--only` | what is said |",
        "| --- | --- | --- | ---: | ---: | --- |",
    ]
    for (target, kind, what), own in sorted(groups.items()):
        said = re.sub(r"[|`<>\[\]]|[^\x20-\x7e]", "?", own[0].said)[:120]
        lines.append(f"| {target} | {kind} | {what} | {len(own)} | {own[0].broken.number} | {said} |")
    return lines


def _show(seed: int, number: int) -> int:
    (found,) = outcomes(seed, [number])
    print(f"{found.broken.target.name}, {found.broken.kind.name}: {found.what}\n{found.said}")
    folder = Path(f"fuzz-{seed}-{number}")
    prepare(found.broken, folder)
    print(f"files in {folder}/")
    return int(found.what in FAULTS)


def main() -> int:
    """Runs the inputs, prints the table; returns 1 where there are faults."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, metavar="K", help="input K alone; its files are left in a folder")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the table here, too")
    options = parser.parse_args()
    if options.only is not None:
        return _show(options.seed, options.only)
    began = time.perf_counter()
    found = outcomes(options.seed, range(options.inputs))
    machine = f"`{command()}`, {describe()}; {time.perf_counter() - began:.0f} s"
    text = "\n".join(["# Broken inputs", "", machine, "", *table(found)]) + "\n"
    print(text, end="")
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    return int(any(o.what in FAULTS for o in found))


if __name__ == "__main__":
    sys.exit(main())
