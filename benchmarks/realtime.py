"""Speed of the simulation over real time, on a slew with stick and slip, on one core, and what friction costs.

MuJoCo's chain and the compiled equations of motion that the search integrates are timed by number of segments, with
MuJoCo's native mechanisms alone and with one that needs a callback at every stage of every step. Beside them runs a
bare `mj_step` with the same steps, called once a row of the recording: of the very model that the chain steps, which
has no friction, and of the rig as `twin` exports it, whose joint has MuJoCo's own `frictionloss`, and sensors. All run
in turn, and a ratio is the median over the rounds.
"""

from __future__ import annotations

from collections.abc import Callable

import machine
import mujoco
import numpy as np
from frequencies import DURATION, Slew, slew

from twin.mechanics import mjcf, planar
from twin.mechanics.chain import Chain, build
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import Plant, declared_plant
from twin.parameters import Rig
from twin.rigs import preset

SEGMENTS = (4, 5, 6, 8, 12)
PERIODS = (1e-3, 2e-3)  # s, between the rows of a recording
LONGEST_STEP = 1e-3  # s, of simulations: the usual sample period allows no longer one
ROUNDS = 9
NAMES = ("bare", "exported", "friction", "lag", "planar")


def chain_run(rig: Rig, links: Chain, plant: Plant, motion: Slew, step: float) -> Callable[[], object]:
    """The slew on MuJoCo's chain, friction handling included."""
    engine, rest = MujocoChain(rig, links, plant), np.zeros(len(links.lengths))
    return lambda: engine.simulate(*motion, rest, rest, 0, False, step)


def planar_run(links: Chain, plant: Plant, motion: Slew, step: float) -> Callable[[], object]:
    """The slew by the compiled equations of motion."""
    rest = np.zeros(len(links.lengths))
    return lambda: planar.simulate(plant, *motion, rest, rest, 0, False, step)


def bare_run(spec: mujoco.MjSpec, motion: Slew, step: float) -> Callable[[], None]:
    """As many steps of a model by `mj_step` alone, from a deflected link at rest."""
    model = spec.compile()
    data, rows, period = mujoco.MjData(model), len(motion.out) - 1, float(motion.out[1])
    count = int(np.ceil(period / step - 1e-9))
    model.opt.timestep = period / count

    def run() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[1] = 0.01
        for _ in range(rows):
            mujoco.mj_step(model, data, count)

    return run


def bare_spec(rig: Rig, links: Chain, plant: Plant) -> mujoco.MjSpec:
    """The model that the chain steps while its hub slides; nothing limits or touches anything."""
    spec = mjcf.dynamics_spec(links, plant, rig, compact=True)
    for flag in (mujoco.mjtDisableBit.mjDSBL_CONSTRAINT, mujoco.mjtDisableBit.mjDSBL_CONTACT):
        spec.option.disableflags |= int(flag)
    return spec


def main() -> None:
    """Prints the table."""
    rig = preset("bossi2009")
    print(f"`{machine.command()}` on {machine.describe()}\n")
    print(
        "Simulated over processor time, and what friction handling multiplies the time of a bare step by.\n"
    )
    print("| segments | rows ms | step ms | bare mj_step | exported rig, mj_step | MuJoCo chain |", end="")
    print(" the same, with a callback (actuator lag) | planar | chain over bare | chain over exported |")
    print("| ---: " * 10 + "|")
    for n in SEGMENTS:
        links = build(rig, n)
        plant = declared_plant(rig, links)
        step = min(links.largest_step(), LONGEST_STEP)
        for period in PERIODS:
            motion = slew(rig)._replace(out=np.arange(0, DURATION, period))
            runs = (
                bare_run(bare_spec(rig, links, plant), motion, step),
                bare_run(mjcf.build_spec(rig, links, plant), motion, step),
                chain_run(rig, links, plant, motion, step),
                chain_run(rig, links, plant.with_motor(lag=0.005), motion, step),
                planar_run(links, plant, motion, step),
            )
            t = dict(zip(NAMES, machine.paired(runs, ROUNDS).T, strict=True))
            cells = [f"{DURATION / np.median(t[name]):.0f}" for name in NAMES]
            cells += [f"{np.median(t['friction'] / t[name]):.2f}" for name in ("bare", "exported")]
            print(f"| {n} | {1e3 * period:.0f} | {1e3 * step:.3f} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
