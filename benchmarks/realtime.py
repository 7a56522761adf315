"""Speed of the simulation over real time, on a slew with stick and slip, on one core.

MuJoCo's chain and the compiled equations of motion that the search integrates are timed by number of segments, with
MuJoCo's native mechanisms alone and with one that needs a callback at every stage of every step.
"""

from __future__ import annotations

import machine
import numpy as np
from frequencies import DURATION, Slew, slew

from twin.mechanics import planar
from twin.mechanics.chain import Chain, build
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import Plant, declared_plant
from twin.parameters import Rig
from twin.rigs import preset

SEGMENTS = (4, 5, 6, 8, 12)
LONGEST_STEP = 1e-3  # s, of simulations: the usual sample period allows no longer one


def times_real_time(rig: Rig, links: Chain, plant: Plant, motion: Slew, engine: str) -> float:
    """Simulated time over processor time [1]."""
    step, rest = min(links.largest_step(), LONGEST_STEP), np.zeros(len(links.lengths))
    arguments = (*motion, rest, rest, 0, False, step)
    simulate = planar.simulate if engine == "planar" else MujocoChain(rig, links, plant).simulate
    run = (lambda: simulate(plant, *arguments)) if engine == "planar" else (lambda: simulate(*arguments))
    run()  # compiles
    return DURATION / machine.timed(run, repeats=5)[1]


def main() -> None:
    """Prints the table."""
    rig = preset("bossi2009")
    motion = slew(rig)
    print(f"`{machine.command()}` on {machine.describe()}\n")
    print("| segments | step ms | MuJoCo | MuJoCo, with a callback (actuator lag) | planar |")
    print("| ---: " * 5 + "|")
    for n in SEGMENTS:
        links = build(rig, n)
        plant = declared_plant(rig, links)
        lagging = plant.with_motor(lag=0.005)
        cells = [
            f"{times_real_time(rig, links, p, motion, engine):.0f}"
            for p, engine in ((plant, "mujoco"), (lagging, "mujoco"), (plant, "planar"))
        ]
        step = 1e3 * min(links.largest_step(), LONGEST_STEP)
        print(f"| {n} | {step:.3f} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
