"""Does a diagnosis that is killed at any instant leave whole results, and a folder that can be used again?

python benchmarks/kill.py CAMPAIGN [--instants 20] [--write]     --write: into benchmarks/results/kill.md

Half of the instants are spread over the work of `twin diagnose CAMPAIGN`, which each time would write over earlier
results; the other half over the writing of these results, which a process does again and again, old and new in turn.
Each instant is tried with SIGINT, SIGTERM and SIGKILL. On POSIX alone.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

from machine import command, describe

from twin import terminal
from twin.files.outputs import MARKER, ResultsFolder
from twin.files.whole import is_temporary

RESULT = Path(__file__).parent / "results" / "kill.md"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
ENDS = {
    signal.SIGINT: (terminal.INTERRUPTED, "Interrupted.\n"),
    signal.SIGTERM: (terminal.TERMINATED, "Terminated.\n"),
    signal.SIGKILL: (-signal.SIGKILL, ""),
}
"""Signal -> exit code and standard error that are right."""
_FIRST = 0.5  # s, when the command has begun; before, Python itself ends in its own way
_WORK = 0.95  # last instant of the work, over the duration of the whole command
_PATIENCE = 60.0  # s, until a process that does not end is one that does not heed its signal

Contents = Mapping[str, bytes]
"""Name of a file of the results -> content."""


@dataclass(frozen=True)
class Trial:
    """A process that was killed.

    Attributes:
      stage: "work" or "writing".
      number: the signal.
      right_end: whether exit code and message are those of the signal.
      wait: from the signal to the end of the process [s].
      torn: files of the results that are neither old nor new.
      temporary: number of temporary files left behind.
      processes: number of processes left behind.
      accepted: whether the folder is accepted by the next run, which removes temporary files.
    """

    stage: str
    number: signal.Signals
    right_end: bool
    wait: float
    torn: tuple[str, ...]
    temporary: int
    processes: int
    accepted: bool

    @property
    def good(self) -> bool:
        """Whether all is as it should be; only SIGKILL, which no process notices, may leave temporary files."""
        clean = self.temporary == 0 or self.number == signal.SIGKILL
        return self.right_end and not self.torn and clean and not self.processes and self.accepted


def results_folder(contents: Contents) -> ResultsFolder:
    """Returns the description of a folder with such results."""
    return ResultsFolder("diagnosis", {n: n for n in contents}, "diagnosis.json", frozenset())


def read_contents(folder: Path) -> dict[str, bytes]:
    """Returns the results in a folder, without the marker."""
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.name != MARKER}


def writing_trial(out: Path, old: Path, new: Path, number: signal.Signals, delay: float) -> Trial:
    """Kills a process that writes the results in `old` and `new` to `out` in turn, `delay` [s] after it began."""
    versions = [read_contents(old), read_contents(new)]
    results_folder(versions[0]).write(out, versions[0])
    process = start([__file__, "--again-and-again", str(out), str(old), str(new)])
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    time.sleep(delay)
    return _kill(process, "writing", number, out, versions)


def work_trial(campaign: Path, out: Path, number: signal.Signals, delay: float) -> Trial | None:
    """Kills a diagnosis `delay` [s] after it began; returns None if it has ended by then."""
    versions = [read_contents(out)]
    process = start(["-m", "twin.cli", "diagnose", str(campaign), "--out", str(out)])
    try:
        process.wait(delay)
        return None
    except subprocess.TimeoutExpired:
        return _kill(process, "work", number, out, versions)


def start(arguments: Sequence[str]) -> subprocess.Popen[str]:
    """Starts Python in a session of its own, with interrupts that are not ignored as those of background jobs are."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def _kill(
    process: subprocess.Popen[str],
    stage: str,
    number: signal.Signals,
    out: Path,
    versions: Sequence[Contents],
) -> Trial:
    """Sends the signal and looks at what is left."""
    sent = time.perf_counter()
    process.send_signal(number)
    try:
        _, error = process.communicate(timeout=_PATIENCE)
    except subprocess.TimeoutExpired:  # it goes on: its end will not be right
        process.kill()
        _, error = process.communicate()
    wait = time.perf_counter() - sent
    found = {p.name: p.read_bytes() for p in out.iterdir() if p.name != MARKER}
    temporary = [name for name in found if is_temporary(name)]
    torn = [n for n in found if n not in temporary and all(found[n] != v.get(n) for v in versions)]
    return Trial(
        stage,
        number,
        (process.returncode, error) == ENDS[number],
        wait,
        (*torn, *(name for name in versions[0] if name not in found)),
        len(temporary),
        session_size(process.pid),
        _accepted(out, versions[0]),
    )


def session_size(session: int, wait: float = 1.0) -> int:
    """Returns the number of processes in a session, which have so much time to end [s]."""
    deadline = time.monotonic() + wait
    while True:
        listed = subprocess.run(["ps", "-eo", "sid="], capture_output=True, text=True, check=True).stdout
        size = listed.split().count(str(session))
        if not size or time.monotonic() >= deadline:
            return size
        time.sleep(0.05)


def _accepted(out: Path, contents: Contents) -> bool:
    """Whether the next run accepts a folder, and leaves no temporary file of the killed one."""
    results_folder(contents).choose(out, out)
    return not any(is_temporary(path.name) for path in out.iterdir())


def trials(campaign: Path, work: Path, instants: int) -> Iterator[Trial]:
    """Yields the trials with each signal; `work` is an empty folder."""
    old, new, out = work / "old", work / "new", work / "out"
    began = time.perf_counter()
    for folder in (old, new):
        with start(["-m", "twin.cli", "diagnose", str(campaign), "--out", str(folder)]) as process:
            process.communicate()
        if process.returncode:
            raise SystemExit(f"{campaign} cannot be diagnosed")
    duration = (time.perf_counter() - began) / 2
    first = time.perf_counter()
    results_folder(read_contents(old)).write(out, read_contents(old))
    writing = time.perf_counter() - first
    half = instants // 2
    for number in SIGNALS:
        for k in range(instants - half):
            # Two rounds of old and new.
            yield writing_trial(out, old, new, number, 4 * writing * (k + 0.5) / (instants - half))
        for k in range(half):
            delay = _FIRST + (_WORK * duration - _FIRST) * (k + 0.5) / half
            trial = work_trial(campaign, out, number, delay)
            if trial is not None:
                yield trial


def table(done: Sequence[Trial]) -> Iterator[str]:
    """Yields the lines of a table with a row for each stage and signal."""
    yield "| stage | signal | killed | as it should be | files torn | temporary files | longest wait [s] |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for stage in ("work", "writing"):
        for number in SIGNALS:
            mine = [t for t in done if (t.stage, t.number) == (stage, number)]
            if mine:
                yield (
                    f"| {stage} | {number.name} | {len(mine)} | {sum(t.good for t in mine)} | "
                    f"{sum(len(t.torn) for t in mine)} | {sum(t.temporary for t in mine)} | "
                    f"{max(t.wait for t in mine):.2f} |"
                )


def write_again_and_again(out: Path, versions: Sequence[Contents]) -> None:
    """Writes results in turn, until it is killed."""
    folder = results_folder(versions[0])
    print("writing", flush=True)
    for contents in cycle(versions[::-1]):
        folder.write(out, contents)


def main() -> None:
    """Prints the table; writes it with `--write`."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--instants", type=int, default=20)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    done = []
    with tempfile.TemporaryDirectory() as work:
        for trial in trials(options.campaign, Path(work), options.instants):
            done.append(trial)
            print("." if trial.good else f"\n{trial}", end="", flush=True)
    text = "\n".join(["# Killed diagnoses", "", f"`{command()}`, {describe()}", "", *table(done), ""])
    print(f"\n{text}")
    if options.write:
        RESULT.write_text(text, encoding="utf-8")
    sys.exit(not all(trial.good for trial in done))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--again-and-again"]:
        place, *folders = map(Path, sys.argv[2:])
        terminal.run(lambda: write_again_and_again(place, [read_contents(f) for f in folders]))
    main()
