"""How far two exact engines differ: recordings of the virtual rig's own and of Exudyn's, without noise.

    python benchmarks/engines.py [--seed 5]

An effect that changes recordings by less than the engines differ cannot be told from how a rig is computed. Beside it
stands what 0.1 % of the static friction changes: a hub that sticks and slips near its static level repeats itself no
better. Both engines get the same commands, where a ramp ends included.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from exudyn_rig import exudyn_engine
from machine import command, describe

from twin.virtual_rig import Rig, Sensors
from twin.virtual_rig.beam import Array
from twin.virtual_rig.campaign_writer import ritz_engine
from twin.virtual_rig.experiments import HUB_RANGE, Experiment, planned_campaign
from twin.virtual_rig.sensors import Sensed

STATIC_CHANGE = 1e-3
"""Relative change of the static friction."""


def differences(a: Sensed, b: Sensed, sensors: Sensors) -> list[float]:
    """Returns the RMS differences of hub angle and strains, in noise levels, while the hub is in range."""
    seen = np.abs(b.hub_angle) <= HUB_RANGE
    columns = [
        (a.hub_angle - b.hub_angle) / sensors.hub_noise,
        *((a.strain - b.strain) / sensors.strain_noise).T,
    ]
    return [float(np.sqrt(np.mean(column[seen] ** 2))) for column in columns]


def compared(rig: Rig, sensors: Sensors, plan: Experiment) -> tuple[list[float], list[float], float]:
    """Returns the differences between the engines, those by the static friction, and Exudyn's processor time [s]."""
    times: Array = np.arange(len(plan.commands)) / sensors.sample_rate
    silence = np.zeros(len(times))
    own = ritz_engine(rig, sensors, plan, times, silence)
    if plan.reference is None:
        plan = replace(plan, commands=own.commands, ramps=())
    began = time.process_time()
    other = exudyn_engine(rig, sensors, plan, times, silence)
    seconds = time.process_time() - began
    up = 1.0 + STATIC_CHANGE
    stiffer = rig._replace(static_positive=up * rig.static_positive, static_negative=up * rig.static_negative)
    changed = ritz_engine(stiffer, sensors, plan, times, silence)
    return differences(other, own, sensors), differences(changed, own, sensors), seconds


def rows(seed: int) -> Iterator[str]:
    """Yields the rows of the table."""
    rig, sensors = Rig(), Sensors()
    for plan in planned_campaign(rig, sensors, np.random.default_rng([seed, 2])):
        engines, friction, seconds = compared(rig, sensors, plan)
        cells = [plan.name, *(f"{value:.2f}" for value in (*engines, *friction)), f"{seconds:.0f} s"]
        yield "| " + " | ".join(cells) + " |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=5, help="of the experiments")
    options = parser.parse_args()
    print(f"`{command()}`, {describe()}\n")
    print(
        "RMS differences in noise levels: of the two engines, and of the virtual rig with 0.1 % more static friction.\n"
    )
    print(
        "| recording | hub | base | middle | hub, friction | base, friction | middle, friction | time of Exudyn |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for row in rows(options.seed):
        print(row, flush=True)


if __name__ == "__main__":
    main()
