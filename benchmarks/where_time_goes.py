"""Where the time of a diagnosis goes: stages, purposes of the simulations, processors that are busy, memory.

Usage: python benchmarks/where_time_goes.py CAMPAIGN... [--name TEXT]... [--workers N]

Without a campaign, the bundled demo. Processor time counts all threads, and the processes beside this one that compute
residuals; that of a purpose is what passed while its simulations ran, and the purpose is found from the functions that
asked for them. Busy processors are counted as threads that run or wait for a processor, every 20 ms, so that other work
on the machine does not change them (Linux only). Memory is the most that these processes hold together.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import machine
import psutil
from machine import processes, processor_time

from twin.campaigns.campaign import read_campaign
from twin.diagnosis.diagnose import diagnose
from twin.estimation.workbench import Workbench

PURPOSES = {
    "permutation_scores": "false-alarm rate by permutation",
    "effect_slopes": "slopes of the candidates",
    "wave_slopes": "slopes of the candidates",
    "best_on_rays": "sizes of the candidates",
    "_point_off_neutral": "sizes of the candidates",
    "_large_sizes": "sizes of the candidates",
    "fit_quickly": "quick fits of the candidates",
    "fit_fully": "full fits of the best candidates",
    "confirm_in_fine_limit": "discretisation limit",
    "without_discretisation_error": "discretisation limit",
    "first_state": "first states",
    "fit_output_error": "output errors: fits",
    "prefer_closer_free_runs": "free runs",
    "with_jackknife_covariance": "standard errors",
    "with_errors": "standard errors",
    "find_functions": "torques outside the library",
    "revise": "revision of what was adopted",
    "likeliest_clock": "clock of the commands",
    "better_calibration": "calibration repeated",
    "refit_with_own_noise": "calibration repeated",
    "final_models": "reported models",
    "fit_patch": "patch",
    "plans_for_pair": "planned experiments",
    "calibrate": "calibration",
}
"""Function -> what it simulates for; the innermost one on the stack counts."""
OTHER = "other"
SAMPLE = 0.02  # s, between two counts of busy threads
MEMORY_SAMPLES = 25  # counts of threads from one look at the memory to the next
FEW = 0.005  # share of the processor time below which a line is added to the last one


@dataclass
class Cost:
    """Calls, simulated models and processor time [s] of a purpose."""

    calls: int = 0
    models: int = 0
    cpu: float = 0.0


@dataclass
class Account:
    """What a diagnosis cost: processor time by stage [s], by purpose, seconds by number of busy threads."""

    stages: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    purposes: dict[str, Cost] = field(default_factory=lambda: defaultdict(Cost))
    busy: Counter[int] = field(default_factory=Counter)
    cpu: float = 0.0
    wall: float = 0.0
    memory: float = 0.0  # MiB, peak of all processes together
    answer: str = ""


def purpose() -> str:
    """Returns what the functions on the stack simulate for."""
    frame: Any = sys._getframe(1)
    while frame is not None:
        if (found := PURPOSES.get(frame.f_code.co_name)) is not None:
            return found
        frame = frame.f_back
    return OTHER


@contextmanager
def counted_simulations(account: Account) -> Iterator[None]:
    """Counts the simulations of a fit by purpose."""
    residuals = Workbench.residuals

    def counted(self: Workbench, jobs: Sequence[Any]) -> list[Any]:
        start, cost, jobs = processor_time(), account.purposes[purpose()], list(jobs)
        result = residuals(self, jobs)
        cost.calls += 1
        cost.models += len(jobs)
        cost.cpu += processor_time() - start
        return result

    Workbench.residuals = counted  # type: ignore[method-assign]
    try:
        yield
    finally:
        Workbench.residuals = residuals  # type: ignore[method-assign]


@contextmanager
def sampled(account: Account) -> Iterator[None]:
    """Counts, from time to time, the threads that run or wait for a processor, and the memory."""
    over = threading.Event()

    def sample() -> None:
        own, began = str(threading.get_native_id()), processes()
        while not over.wait(SAMPLE):
            tasks = [(p.pid, task) for p in began for task in tasks_of(p.pid) if task != own]
            account.busy[sum(runs(*task) for task in tasks)] += 1
            if sum(account.busy.values()) % MEMORY_SAMPLES == 0:
                began = processes()
                account.memory = max(account.memory, sum(memory_of(p) for p in began))

    sampler = threading.Thread(target=sample, daemon=True)
    sampler.start()
    try:
        yield
    finally:
        over.set()
        sampler.join()


def memory_of(process: psutil.Process) -> float:
    """Memory of a process [MiB]: what it shares with others counts in equal parts."""
    try:
        return process.memory_full_info().pss / 2**20
    except psutil.Error:
        return 0.0  # it has ended


def tasks_of(process: int) -> list[str]:
    """Threads of a process."""
    try:
        return os.listdir(f"/proc/{process}/task")
    except OSError:
        return []  # it has ended


def runs(process: int, task: str) -> bool:
    """Whether a thread of a process runs or waits for a processor."""
    try:
        text = Path(f"/proc/{process}/task/{task}/stat").read_text(encoding="ascii")
    except OSError:
        return False  # it has just ended
    return text.rpartition(")")[2].split()[0] == "R"


def measure(folder: Path, workers: int) -> Account:
    """Diagnoses a campaign; returns what that cost."""
    account = Account()
    campaign = read_campaign(folder)
    wall, cpu = time.perf_counter(), processor_time()
    stage, since = "reading", cpu

    def begin(text: str) -> None:
        nonlocal stage, since
        now = processor_time()
        account.stages[stage] += now - since
        # "adopting friction" -> "adopting"
        stage, since = ("adopting an effect" if text.startswith("adopting") else text), now

    with counted_simulations(account), sampled(account):
        found = diagnose(campaign, begin, workers)
    account.answer = ", ".join([found.verdict, *(effect.name for effect in found.effects)])
    begin("")
    account.cpu, account.wall = processor_time() - cpu, time.perf_counter() - wall
    return account


def print_account(name: str, account: Account, workers: int) -> None:
    """Prints the tables of one campaign."""
    total, counts = account.cpu, sum(account.busy.values())
    full = sum(n for threads, n in account.busy.items() if threads >= workers) / max(counts, 1)
    simulated = sum(c.models for c in account.purposes.values())
    print(f"## {name}: {account.answer}\n")
    print(
        f"{account.wall:.1f} s, {total:.1f} s of processor time, {simulated} models simulated on all recordings;"
    )
    print(
        f"{workers} processors busy for {100 * full:.0f} % of the time; peak memory {account.memory:.0f} MiB.\n"
    )
    print("| stage, until the next | CPU s | share % |\n| --- | ---: | ---: |")
    for stage, cpu in account.stages.items():
        if cpu >= FEW * total:
            print(f"| {stage} | {cpu:.1f} | {100 * cpu / total:.0f} |")
    print("\n| simulations for | calls | models | CPU s | share % |\n| --- | ---: | ---: | ---: | ---: |")
    rows = sorted(account.purposes.items(), key=lambda row: -row[1].cpu)
    for what, cost in rows:
        print(f"| {what} | {cost.calls} | {cost.models} | {cost.cpu:.1f} | {100 * cost.cpu / total:.0f} |")
    rest = total - sum(c.cpu for c in account.purposes.values())
    print(f"| no simulation of a fit | | | {rest:.1f} | {100 * rest / total:.0f} |\n", flush=True)


def main() -> None:
    """Prints the tables of each campaign."""
    parser = argparse.ArgumentParser(description="Where the time of a diagnosis goes.")
    parser.add_argument(
        "campaigns", nargs="*", type=Path, default=[Path(str(files("twin") / "data" / "demo-rig"))]
    )
    parser.add_argument("--name", action="append", default=[], help="of each campaign in the table, in order")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    names = [*given.name, *(folder.name for folder in given.campaigns[len(given.name) :])]
    print(f"`{machine.command()}` on {machine.describe()}\n", flush=True)
    for name, folder in zip(names, given.campaigns, strict=True):
        print_account(name, measure(folder, given.workers), given.workers)


if __name__ == "__main__":
    main()
