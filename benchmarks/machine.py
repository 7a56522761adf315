"""Description of the machine of a benchmark, and timing."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np


def describe() -> str:
    """Returns processor, cores, Python and main libraries in one line."""
    libraries = ", ".join(f"{name} {version(name)}" for name in ("mujoco", "numba", "numpy", "scipy"))
    return f"{_processor()}, {os.cpu_count()} cores; Python {platform.python_version()}, {libraries}"


def command() -> str:
    """Returns the command line of this script."""
    return " ".join(["python", f"benchmarks/{Path(sys.argv[0]).name}", *sys.argv[1:]])


def processes() -> list[Any]:
    """This process, and those that it has started, as `psutil.Process`."""
    import psutil  # of the extra "benchmarks"; most scripts do without

    own = psutil.Process()
    return [own, *own.children(recursive=True)]


def processor_time() -> float:
    """Processor time of all threads of these processes [s]: a diagnosis computes residuals in several."""
    return sum(t.user + t.system for p in processes() if (t := p.cpu_times()))


def timed(run: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """Returns the result and the least processor time of several runs [s], which other load disturbs least."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
    return result, min(times)


def paired(
    runs: Sequence[Callable[[], Any]], rounds: int, clock: Callable[[], float] = time.process_time
) -> np.ndarray:
    """Returns times (rounds x runs) [s] of runs that take turns, after one that is not timed: it compiles."""
    for run in runs:
        run()
    times = np.empty((rounds, len(runs)))
    for row in times:
        for i, run in enumerate(runs):
            start = clock()
            run()
            row[i] = clock() - start
    return times


def peer(module: str, install: str) -> ModuleType:
    """Returns a module that only benchmarks need.

    Raises:
      SystemExit: it is not installed; says how to install it.
    """
    try:
        return import_module(module)
    except ImportError:
        raise SystemExit(
            f"{module} is not installed, which this row compares with: pip install {install}"
        ) from None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
