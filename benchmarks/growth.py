"""How the cost of a diagnosis grows: length of recordings, their number, sample rate, segments, candidates.

Usage: python benchmarks/growth.py [QUANTITY...] [--lengths MINUTES...]

Recordings of the virtual rig, slews of random size to and fro, nothing missing, changed in one respect at a time from
one recording of half a minute at 500 Hz. Each diagnosis runs in a process of its own, so that its peak memory is its
own; time is processor time on all threads. The exponent is the slope of the logarithms from the first row of a
quantity. `length-1khz` has the lengths of --lengths at 1 kHz.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import machine
import numpy as np

from twin.virtual_rig import Rig, Sensors, make_campaign
from twin.virtual_rig.experiments import Experiment, rigid_inertia

PLAIN = (0.5, 1, 500.0, 5, 26)
"""Minutes of a recording, recordings, sample rate [Hz], segments, candidates."""
QUANTITIES = {
    "length": (0, (0.5, 1.0, 2.0)),
    "recordings": (1, (1, 2, 4)),
    "rate": (2, (250.0, 500.0, 1000.0)),
    "segments": (3, (4, 5, 8)),
    "candidates": (4, (7, 13, 26)),
}
"""Name -> place in `PLAIN`, values."""
CYCLE = 4.0  # s, of a slew there and back


class Cost(NamedTuple):
    """Processor time of calibration and diagnosis [s], peak memory [MiB]."""

    calibration: float
    diagnosis: float
    memory: float


def slews(minutes: float, sensors: Sensors, generator: np.random.Generator) -> np.ndarray:
    """Torque [N m] of slews of 15 to 60 degrees, each there and back, as they take the rigid frictionless rig."""
    t = np.arange(round(60 * minutes * sensors.sample_rate)) / sensors.sample_rate
    torque = np.zeros(len(t))
    for start in np.arange(0.4, 60 * minutes - CYCLE, CYCLE):
        angle, height = np.radians(generator.uniform(15, 60)), generator.uniform(0.1, 0.185)
        length = np.sqrt(angle * rigid_inertia(Rig()) / height)
        for begin, sign in ((start, 1), (start + CYCLE / 2, -1)):
            torque[(t >= begin) & (t < begin + length)] = sign * height
            torque[(t >= begin + length) & (t < begin + 2 * length)] = -sign * height
    return np.round(torque, 5)


def make(folder: Path, minutes: float, recordings: int, rate: float) -> None:
    """Writes a campaign."""
    sensors, generator = Sensors(sample_rate=rate), np.random.default_rng(1)
    plans = [
        Experiment(f"slews-{i}", "bang-bang", "fit", -0.5, slews(minutes, sensors, generator))
        for i in range(recordings)
    ]
    make_campaign(folder, {}, 1, sensors=sensors, experiments=plans, perturb=1.0)


def measure(folder: str, segments: int, candidates: int) -> Cost:
    """Calibrates and diagnoses a campaign in this process."""
    from twin.campaigns.campaign import read_campaign
    from twin.diagnosis.diagnose import diagnose
    from twin.effects import REGISTRY, unregister
    from twin.estimation import calibrate

    calibrate.SEARCH_SEGMENTS = segments
    for name in list(REGISTRY)[candidates:]:
        unregister(name)
    campaign, began = read_campaign(folder), {}

    def begin(text: str) -> None:
        began.setdefault(text, time.process_time())

    start = time.process_time()
    diagnose(campaign, begin, workers=2)
    end = time.process_time()
    after = [at for text, at in began.items() if at > began["calibrating"]]
    calibrated = min(after, default=end)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Cost(calibrated - start, end - calibrated, memory)


def apart(folder: Path, segments: int, candidates: int) -> Cost:
    """Calibrates and diagnoses a campaign in a process of its own."""
    command = [sys.executable, __file__, "--one", str(folder), str(segments), str(candidates)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return Cost(*json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Prints the table, or measures one campaign."""
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measure(sys.argv[2], *map(int, sys.argv[3:]))))
        return
    parser = argparse.ArgumentParser(description="How the cost of a diagnosis grows.")
    parser.add_argument("quantities", nargs="*", default=list(QUANTITIES))
    parser.add_argument("--lengths", nargs="+", type=float, default=[1.0, 10.0], help="of length-1khz [min]")
    given = parser.parse_args()
    print(f"`{machine.command()}` on {machine.describe()}\n")
    print(
        "| quantity | value | calibration, CPU s | rest of the diagnosis, CPU s | peak MiB | exponent of the time |"
    )
    print("| --- " + "| ---: " * 5 + "|")
    for name in given.quantities:
        plain = PLAIN
        if name == "length-1khz":
            place, values, plain = 0, tuple(given.lengths), (*PLAIN[:2], 1000.0, *PLAIN[3:])
        else:
            place, values = QUANTITIES[name]
        print_rows(name, place, values, plain)


def print_rows(name: str, place: int, values: tuple[float, ...], plain: tuple[float, ...]) -> None:
    """Prints the rows of a quantity."""
    first: Cost | None = None
    for value in values:
        minutes, recordings, rate, segments, candidates = (*plain[:place], value, *plain[place + 1 :])
        with tempfile.TemporaryDirectory() as folder:
            campaign = Path(folder) / "campaign"
            make(campaign, minutes, int(recordings), rate)
            cost = apart(campaign, int(segments), int(candidates))
        total = cost.calibration + cost.diagnosis
        first = first or cost
        shown = ""
        if value != values[0]:
            growth = total / (first.calibration + first.diagnosis)
            shown = f"{np.log(growth) / np.log(value / values[0]):.2f}"
        print(
            f"| {name} | {value:g} | {cost.calibration:.1f} | {cost.diagnosis:.1f} | {cost.memory:.0f} | {shown} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
