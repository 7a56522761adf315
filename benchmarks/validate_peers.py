"""One controller on many drawn rigs, beside a plain loop of MuJoCo rollouts.

Both try the LQ regulator with the step of 120 degrees (5 s, 500 Hz) on the same drawn rigs, chains of 8 segments, on
one thread: `twin validate` with compiled equations, stick and slip, metrics and the margins of each linear loop; the
loop with `mujoco.rollout`, all rigs at once over one sample period after the other, of the rig as `twin` exports it at
its own time step, a controller for each rig and no metrics. Both take turns; medians of the processor time per rig,
and thousand times that.
"""

from __future__ import annotations

import argparse
import math

import machine
import mujoco
import mujoco.rollout
import numpy as np
from threadpoolctl import threadpool_limits

from twin.control import plants, scenarios
from twin.mechanics import mjcf
from twin.mechanics.chain import DEFAULT_SEGMENTS, build, fit_shape
from twin.parameters import Rig
from twin.rigs import preset
from twin.validation.fleet import Evaluator, Job
from twin.validation.rigs import DrawnRig, draw_rigs, uncertain_parameters

CONTROLLER, SCENARIO = "lqi", "lq-step-120"
CHANNELS = ("hub_angle", "strain_base", "strain_mid", "tip_from_hub")
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS


def by_twin(job: Job, rigs: list[DrawnRig]) -> np.ndarray:
    """Hub angle at the end [rad] of each rig, by twin."""
    bench = Evaluator(job)
    return np.array([bench.outcome(drawn).traces["hub_angle"][-1] for drawn in rigs])


def compiled(nominal: Rig, rigs: list[DrawnRig]) -> list[mujoco.MjModel]:
    """The exported rigs; the proportions of the chain are those of the nominal one."""
    shape = fit_shape(nominal, DEFAULT_SEGMENTS)
    specs = [mjcf.build_spec(drawn.rig, build(drawn.rig, DEFAULT_SEGMENTS, shape)) for drawn in rigs]
    for spec in specs:
        spec.option.timestep = plants.PERIOD / math.ceil(plants.PERIOD / mjcf.TIMESTEP)
    return [spec.compile() for spec in specs]


def by_rollouts(job: Job, rigs: list[DrawnRig]) -> np.ndarray:
    """Hub angle at the end [rad] of each rig, by rollouts of MuJoCo over one sample period after the other."""
    models, scenario = compiled(job.rig, rigs), scenarios.scenario(job.scenario)
    laws = [job.law(plants.PERIOD) for _ in rigs]
    for law in laws:
        law.reset()
    data, steps = mujoco.MjData(models[0]), round(plants.PERIOD / models[0].opt.timestep)
    places = {name: models[0].sensor(name).adr[0] for name in CHANNELS}
    state = np.zeros((len(rigs), mujoco.mj_stateSize(models[0], FULL)))
    readings = [dict.fromkeys(plants.READINGS, 0.0) for _ in rigs]
    control = np.zeros((len(rigs), steps, 1))
    for k in range(round(scenario.duration / plants.PERIOD)):
        time = k * plants.PERIOD
        target = scenario.reference(time)
        for row, law in enumerate(laws):
            control[row] = law.torque({**readings[row], "time": time}, target)
        states, seen = mujoco.rollout.rollout(models, [data], state, control)
        state = states[:, -1]
        for row, reading in enumerate(readings):
            reading["hub_angle"] = float(states[row, -1, 1])
            reading["strain_base"] = float(seen[row, -1, places["strain_base"]])
            reading["strain_mid"] = float(seen[row, -1, places["strain_mid"]])
            reading["tip_deflection"] = float(seen[row, -1, places["tip_from_hub"] + 1])
    return state[:, 1]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description="A controller on many rigs, beside a loop of MuJoCo rollouts."
    )
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    nominal = preset("bossi2009")
    drawn = draw_rigs(nominal, {}, uncertain_parameters(nominal, {}, {}), given.rigs, 0)
    job = Job(CONTROLLER, nominal, SCENARIO)
    with threadpool_limits(1):
        by_twin(job, drawn[:1])
        ends = np.degrees([by_twin(job, drawn), by_rollouts(job, drawn)])
        times = machine.paired([lambda: by_twin(job, drawn), lambda: by_rollouts(job, drawn)], given.rounds)
    per_rig = np.median(times, axis=0) / len(drawn)
    print(f"`{machine.command()}` on {machine.describe()}\n")
    print("| | CPU ms per rig | CPU s for 1,000 rigs | hub angle at the end, mean and spread, deg |")
    print("| --- " + "| ---: " * 3 + "|")
    for name, cost, end in zip(("twin validate", "loop of rollouts"), per_rig, ends, strict=True):
        print(f"| {name} | {1e3 * cost:.1f} | {1e3 * cost:.0f} | {end.mean():.2f}, {end.std():.2f} |")
    print(f"\nThe loop takes {np.median(times[:, 1] / times[:, 0]):.2f} times twin's time.")


if __name__ == "__main__":
    main()
