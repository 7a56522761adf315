"""Logging a run of 60 s to a rerun file: processor time and size.

The paper's sinusoid of 40 degrees under its compensator on the compiled chain, at 500 Hz, with everything that `twin
run` logs: arm, channels, states of the controller.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import machine

from twin.control import closed_loop, plants, scenarios
from twin.report import run_rerun
from twin.rigs import preset

SCENARIO = "sinus-0.2"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description="Time and size of a run in a rerun file.")
    parser.add_argument("--duration", type=float, default=60.0, help="of the run [s]")
    duration = parser.parse_args().duration
    rig, scenario = preset("bossi2009"), scenarios.scenario(SCENARIO)
    plant = plants.make_plant("compiled", rig)
    law = scenario.own_controller(rig, plants.PERIOD)
    run, simulated = machine.timed(lambda: closed_loop.run(plant, law, scenario.reference, duration), 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.rrd"
        track = run_rerun.of_run(run, "run")
        _, written = machine.timed(lambda: run_rerun.write_rrd([track], rig["length"], path, "run"), 3)
        size = path.stat().st_size
    print(f"`{machine.command()}` on {machine.describe()}, rerun-sdk {machine.version('rerun-sdk')}\n")
    print("| run s | samples | simulation, CPU s | logging, CPU s | file MB | bytes per sample |")
    print("| ---: " * 6 + "|")
    row = f"{duration:.0f} | {len(run.time)} | {simulated:.2f} | {written:.2f} | {size / 1e6:.2f}"
    print(f"| {row} | {size / len(run.time):.0f} |")


if __name__ == "__main__":
    main()
