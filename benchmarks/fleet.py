"""How a fleet scales from one worker of a Dask scheduler to two, and where it would stop.

    python benchmarks/fleet.py WORK [--rigs 100] [--campaigns 4]

Scheduler and workers are processes of this machine, a thread each, that have loaded the equations of motion before the
time is taken. A validation has --rigs drawn rigs; a fleet of diagnoses has --campaigns of a virtual rig with nothing
missing, of three slews each, written into WORK. The table is printed, and written to benchmarks/results/fleet.md.
"""

from __future__ import annotations

import argparse
import os
import pickle
import shutil
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from machine import command, describe

from twin.executors.scheduler import scheduler
from twin.fleet import run, store
from twin.fleet.answer import Fleet
from twin.fleet.task import diagnosed
from twin.rigs import preset
from twin.validation.fleet import Evaluator, Job, run_fleet
from twin.validation.rigs import draw_rigs, uncertain_parameters
from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import planned_campaign

RESULTS = Path(__file__).parent / "results" / "fleet.md"
_WORKERS = (1, 2)
_NETWORK = 1e9 / 8  # bytes per second of a common Ethernet


@dataclass(frozen=True)
class Times:
    """Wall time of the same tasks on one worker and on two [s]."""

    what: str
    tasks: int
    seconds: tuple[float, ...]

    @property
    def gain(self) -> float:
        """Time on one worker over that on two [1]."""
        return self.seconds[0] / self.seconds[1]

    @property
    def serial(self) -> float:
        """Time that more workers do not shorten, by T(w) = serial + parallel / w [s]; not below 0."""
        return max(2 * self.seconds[1] - self.seconds[0], 0.0)


@dataclass(frozen=True)
class Own:
    """What the submitting process does itself for one diagnosis.

    Attributes:
      seconds: reading, sending, writing [s].
      sent, received: bytes of a task and of its results.
      diagnosis: time of a worker [s].
    """

    seconds: float
    sent: int
    received: int
    diagnosis: float

    @property
    def workers(self) -> float:
        """Workers that it keeps busy."""
        return self.diagnosis / self.seconds

    @property
    def workers_of_network(self) -> float:
        """Workers that a network of `_NETWORK` keeps busy."""
        return self.diagnosis * _NETWORK / (self.sent + self.received)


def on_workers(count: int, work: Callable[[Executor], float]) -> float:
    """Returns what `work` measures on so many workers [s]."""
    from distributed import Client, LocalCluster

    options = {"processes": True, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with LocalCluster(n_workers=count, host="127.0.0.1", **options) as cluster:
        with Client(cluster.scheduler_address) as client:
            client.run(_load)
        with scheduler(cluster.scheduler_address) as workers:
            return work(workers)


def _load() -> None:
    """Compiles or loads the equations of motion in a worker."""
    from twin.diagnosis import diagnose  # noqa: F401
    from twin.rigs import preset

    rig = preset("bossi2009")
    Evaluator(Job("lqi", rig, "lq-step-120")).outcome(draw_rigs(rig, {}, (), 0, 0)[0])


def validation(rigs: int) -> Callable[[Executor], float]:
    """Returns a function that validates a controller on so many rigs, and returns the time [s]."""
    rig = preset("bossi2009")
    drawn = draw_rigs(rig, {}, uncertain_parameters(rig, {}, {}), rigs, 0)

    def work(workers: Executor) -> float:
        began = time.perf_counter()
        run_fleet(Job("lqi", rig, "lq-step-120"), drawn, lambda text: None, workers)
        return time.perf_counter() - began

    return work


def diagnoses(campaigns: Sequence[Path], out: Path) -> tuple[Callable[[Executor], float], list[Fleet]]:
    """Returns a function that diagnoses campaigns and returns the time [s], and a list of the answers."""
    fleets: list[Fleet] = []

    def work(workers: Executor) -> float:
        shutil.rmtree(out, ignore_errors=True)
        began = time.perf_counter()
        fleets.append(run.diagnose_fleet(run.Asked(campaigns, out), workers, lambda result: None, diagnosed))
        return time.perf_counter() - began

    return work, fleets


def make_campaigns(work: Path, count: int) -> list[Path]:
    """Writes campaigns of slews, of a virtual rig with nothing missing."""
    made = []
    for seed in range(count):
        plan = planned_campaign(Rig(), Sensors(), np.random.default_rng(seed))
        slews = [e for e in plan if e.name.startswith("bang-bang")]
        made.append(work / "RIGS" / f"rig-{seed}")
        make_campaign(made[-1], {}, seed, experiments=slews, force=True)
    return made


def own_work(campaign: Path, out: Path, answers: Fleet) -> Own:
    """Measures what the submitting process does for one diagnosis that has been written to `out`."""
    [there] = [r for r in answers.answers if r.campaign == campaign]
    contents = {f.name: f.read_bytes() for f in there.folder.iterdir() if not f.name.startswith(".")}
    began = time.perf_counter()
    [job] = run._prepared(run.Asked((campaign,), out))
    sent = pickle.dumps(job.task)
    store.write(job.folder, contents, None)
    store.stored.parsed(contents[run.ANSWER])
    seconds = time.perf_counter() - began
    spent = float(np.mean([r.answer.wall_s for r in answers.answers]))
    return Own(seconds, len(sent), sum(map(len, contents.values())), spent)


def table(measured: Sequence[Times]) -> str:
    """Returns the times as Markdown."""
    lines = [
        "| work | tasks | one worker | two workers | gain | not shortened by workers |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for t in measured:
        one, two = t.seconds
        lines.append(
            f"| {t.what} | {t.tasks} | {one:.1f} s | {two:.1f} s | {t.gain:.2f} | {t.serial:.1f} s |"
        )
    return "\n".join(lines)


def where_it_stops(own: Own) -> str:
    """Returns the calculation of the most workers, with its assumptions."""
    own_time, diagnosis, workers = f"{own.seconds:.2f} s", f"{own.diagnosis:.0f} s", f"{own.workers:.0f}"
    megabytes = f"{own.sent / 1e6:.1f} MB and its results {own.received / 1e6:.1f} MB"
    return f"""
## Where it stops

Calculated, not measured, for a fleet of diagnoses. The process that submits reads and hashes a campaign, sends it, and
writes the results: {own_time} for each, one after another. A diagnosis takes a worker {diagnosis}. So one process
keeps {diagnosis} / {own_time} = {workers} workers busy; beyond that they wait for it, and a fleet takes {own_time} for
each rig. A task has {megabytes}: a network of 1 Gbit/s would keep
{own.workers_of_network:.0f} workers busy.

Assumed: workers with a core of their own each, as fast as this one, that share nothing but the network; campaigns of
this size; more rigs than workers, as the last one to end is waited for; Dask's own time for a task, about 1 ms by its
documentation, left out. The last column of the table is 2 T(2) - T(1), from T(w) = serial + parallel / w: with load
beside the measurement it is as uncertain as the times are.
"""


def main() -> None:
    """Measures, prints the table and writes it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path)
    parser.add_argument("--rigs", type=int, default=100)
    parser.add_argument("--campaigns", type=int, default=4)
    options = parser.parse_args()
    campaigns, out = make_campaigns(options.work, options.campaigns), options.work / "out"
    diagnose, fleets = diagnoses(campaigns, out)
    works = (
        ("rigs of a validation, `lqi`", options.rigs, validation(options.rigs)),
        ("diagnoses of three slews, nothing missing", options.campaigns, diagnose),
    )
    measured = []
    for what, tasks, work in works:
        measured.append(Times(what, tasks, tuple(on_workers(n, work) for n in _WORKERS)))
        print(measured[-1], flush=True)
    own = own_work(campaigns[0], options.work / "own", fleets[-1])
    where = f"`{command()}`, {describe()}, load of the machine at the end {os.getloadavg()[0]:.1f}"
    text = f"{where}\n\n{table(measured)}\n{where_it_stops(own)}"
    print(text)
    RESULTS.write_text(f"# Fleets\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main()
