"""The paper's experiments on all plants against the published results, and the cost of logging and of a validation.

python benchmarks/scenarios.py [--write]     --write: into benchmarks/results/scenarios.md
"""

import argparse
import math
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from machine import command, describe

from twin.control import closed_loop, plants, scenarios
from twin.control.closed_loop import Run
from twin.control.experiment import Experiment
from twin.control.laws.siso import siso
from twin.control.plants.base import PERIOD
from twin.control.plants.chain import CompiledPlant
from twin.control.plants.modal import ModalPlant
from twin.parameters import Rig
from twin.report.run_rerun import of_run, write_rrd
from twin.rigs import preset
from twin.validation import validation
from twin.validation.requirements import defaults

RESULT = Path(__file__).parent / "results" / "scenarios.md"
RIG = preset("bossi2009")
SIMULATED = {20: 18.84, 45: 42.70, 60: 58.25, 90: 85.00, 120: 112.00}  # deg, Bossi et al. 2009, Table III
TURNING = 5.0  # s, duration of a run of Table III

PUBLISHED = {
    "bang-bang-20": "10.49 +- 0.25 deg (model 18.84)",
    "bang-bang-45": "29.15 +- 0.45 deg (model 42.70)",
    "bang-bang-60": "51.60 +- 0.44 deg (model 58.25)",
    "bang-bang-90": "69.00 +- 0.46 deg (model 85.00)",
    "bang-bang-120": "67.62 +- 2.01 deg (model 112.00)",
    "sinus-0.2": "44.6 deg, 18 mm, 0.067 N·m",
    "sinus-0.4": "55 deg, 54 mm, saturates",
    "filtered-step-120": "figure only",
    "lq-step-120": "121.1 +- 0.3 deg",
}


def main() -> None:
    """Prints the tables; writes them with `--write`."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    text = "\n".join(
        [
            "# The paper's experiments",
            "",
            f"`{command()}`, {describe()}",
            "",
            *tables(),
        ]
    )
    print(text)
    if options.write:
        RESULT.write_text(text + "\n", encoding="utf-8")


def tables() -> list[str]:
    """Returns the tables as lines of markdown."""
    lines = [
        "Hub: angle at the end, for sinusoids the amplitude of the second half; then peak deflection and torque.",
        "",
        "| scenario | published | paper's model | chain | modal | RMS hub, modal - chain | RMS tip deflection |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [_row(name) for name in scenarios.SCENARIOS]
    lines += ["", *_bang_bangs(), "", *_friction(), "", *_geometry(), "", *_overhead(), "", *_fleet()]
    return lines


def _row(name: str) -> str:
    runs = {plant: Experiment(name, plant, RIG, {}).run() for plant in ("paper", "chain", "modal")}
    half = scenarios.scenario(name).from_half
    cells = [_figures(name, scenarios.metrics(run, half)) for run in runs.values()]
    shares = [f"{100 * share:.2g} %" for share in _difference(runs["modal"], runs["chain"])]
    return f"| {name} | {PUBLISHED[name]} | {' | '.join(cells)} | {' | '.join(shares)} |"


def _figures(name: str, m: dict[str, float]) -> str:
    hub = (m["hub_max_deg"] - m["hub_min_deg"]) / 2 if name.startswith("sinus") else m["hub_final_deg"]
    return f"{hub:.2f} deg, {m['peak_deflection_mm']:.1f} mm, {m['peak_torque_nm']:.3f} N·m"


def _bang_bangs() -> list[str]:
    """The simulated column of Table III by the paper's model, over the torque amplitude, which the paper omits."""
    lines = [
        "Turns of Table III in degrees by the paper's model, against the amplitude of the torque:",
        "",
        "| amplitude [N·m] | 20 | 45 | 60 | 90 | 120 | RMS to the published ones |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        f"| published | {' | '.join(f'{turn:.2f}' for turn in SIMULATED.values())} | |",
    ]
    plant = plants.make_plant("paper", RIG)
    for amplitude in (0.16, 0.17, 0.18, 0.19, 0.2, 0.21):
        laws = [scenarios.bang_bang(RIG, math.radians(d), plant.period, amplitude) for d in SIMULATED]
        runs = [closed_loop.run(plant, law, lambda time: 0.0, TURNING) for law in laws]
        turned = [scenarios.metrics(run)["hub_final_deg"] for run in runs]
        off = math.sqrt(
            statistics.mean((t - s) ** 2 for t, s in zip(turned, SIMULATED.values(), strict=True))
        )
        lines.append(f"| {amplitude:g} | {' | '.join(f'{t:.2f}' for t in turned)} | {off:.2f} |")
    return lines


def _friction() -> list[str]:
    """Dependence of the 0.2 Hz sinusoid's peaks on the break-away level."""
    lines = [
        "The 0.2 Hz sinusoid against the break-away level: modal plant, and paper's model:",
        "",
        "| break-away [N·m] | hub amplitude [deg] | peak deflection [mm] | peak torque [N·m] | time at rest |",
        "| --- | --- | --- | --- | --- |",
    ]
    for level in (0.0055, 0.04, 0.05, 0.055, 0.06, 0.065, 0.07):
        rig = RIG.replace(static_friction=level)
        experiments = [Experiment("sinus-0.2", plant, rig, {}) for plant in ("modal", "paper")]
        both = [e.metrics(e.run()) for e in experiments]
        cells = (
            ", ".join(f"{(m['hub_max_deg'] - m['hub_min_deg']) / 2:.2f}" for m in both),
            ", ".join(f"{m['peak_deflection_mm']:.1f}" for m in both),
            ", ".join(f"{m['peak_torque_nm']:.4f}" for m in both),
            ", ".join(f"{100 * m['stuck_fraction']:.0f} %" for m in both),
        )
        lines.append(f"| {level:g} | {' | '.join(cells)} |")
    return lines


def _geometry() -> list[str]:
    """Causes of the difference between modal model and chain: smaller motions, no friction, more modes."""
    lines = [
        "The filtered step, modal plant against compiled chain (RMS of the difference over the channel's spread):",
        "",
        "| | hub | tip deflection |",
        "| --- | --- | --- |",
    ]
    smooth = RIG.replace(static_friction=0.0, coulomb_friction=0.0)
    for text, rig, scale, modes in (
        ("as it is, 3 modes", RIG, 1.0, 3),
        ("6 modes", RIG, 1.0, 6),
        ("everything, friction too, made 10 times smaller", RIG, 0.1, 3),
        ("no friction", smooth, 1.0, 3),
        ("no friction, 10 times smaller", smooth, 0.1, 3),
    ):
        hub, tip = _modal_against_chain(rig, scale, modes)
        lines.append(f"| {text} | {100 * hub:.2g} % | {100 * tip:.2g} % |")
    return lines


def _modal_against_chain(rig: Rig, scale: float, modes: int) -> tuple[float, float]:
    """Differences of modal plant and chain in the filtered step, with torques and reference scaled."""
    torques = {name: scale * rig[name] for name in ("static_friction", "coulomb_friction", "torque_limit")}
    model = plants.make_model(rig.replace(**torques))
    step = scenarios.scenario("filtered-step-120")
    modal, chain = (
        closed_loop.run(plant, siso(rig, PERIOD), lambda time: scale * step.reference(time), step.duration)
        for plant in (ModalPlant(model, modes=modes), CompiledPlant(model))
    )
    return _difference(modal, chain)


def _difference(run: Run, other: Run) -> tuple[float, float]:
    """RMS difference of hub angle and of tip deflection, over the standard deviation in the other run [1]."""
    hub, tip = (
        float(np.sqrt(np.mean((run.true[name] - other.true[name]) ** 2)) / np.std(other.true[name]))
        for name in ("hub_angle", "tip_deflection")
    )
    return hub, tip


def _overhead() -> list[str]:
    """Times runs with and without a rerun file, alternating."""
    experiment, bare, logged = Experiment("lq-step-120", "chain", RIG, {}), [], []
    experiment.run()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(7):
            began = time.perf_counter()
            run = experiment.run()
            bare.append(time.perf_counter() - began)
            write_rrd([of_run(run, "chain")], RIG["length"], Path(folder) / "run.rrd", "run")
            logged.append(time.perf_counter() - began)
    ratio = statistics.median(b / a for a, b in zip(bare, logged, strict=True))
    seconds = statistics.median(bare)
    return [
        f"`lq-step-120` on the chain: {seconds:.2f} s for 5 s of motion, built and run "
        f"({math.floor(5 / seconds)} times real time); with its rerun file {ratio:.2f} times that."
    ]


def _fleet() -> list[str]:
    """Times the validation of a controller on 200 rigs."""
    job, began = validation.Job("lqi", RIG, "lq-step-120"), time.perf_counter()
    validation.validate(job, {}, {}, defaults(), 200, 0, lambda text: None)
    seconds = time.perf_counter() - began
    return [f"`lqi` on 200 rigs, as `twin validate` tries them, a step of 5 s each: {seconds:.0f} s in all."]


if __name__ == "__main__":
    main()
