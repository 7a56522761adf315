"""Bias and coverage of total inertia and payload by slews, and of Coulomb friction by the decay of the unclamped link.

    python benchmarks/slews.py WORK [--campaigns 50] [--seed 7000] [--jobs 1] [--minutes M]

For each seed there are two rigs, whose true parameters are drawn from the declared uncertainty: one makes six slews of
30 to 105 degrees, there and back; the other, with a static friction that lets it swing, is released with its tip
deflected by 30 mm. The deflection is declared with an error of 3 %, as a ruler is read to a millimetre. Only the
procedures in question run. The parameters that they take from a joint estimate are the true ones; the payload uses
length, density and tip inertia as declared, as in an identification.

WORK is a folder for the campaigns and `answers.jsonl`; an interrupted run continues from it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import resumable
from machine import describe

from twin.campaigns.campaign import Campaign, read_campaign
from twin.estimation.calibrate import noise_levels
from twin.identification import balance, friction_map, joint, total_inertia
from twin.identification.estimates import Estimate
from twin.mechanics import beam, chain
from twin.parameters import Rig
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, prepare
from twin.rigs.model import FINE_STEP, Model
from twin.virtual_rig import Rig as VirtualRig
from twin.virtual_rig import Sensors, make_campaign
from twin.virtual_rig.experiments import bang_bang, free_release

ANGLES = (30.0, 45.0, 60.0, 75.0, 90.0, 105.0)  # degrees
STATIC_FRICTION = 0.02  # N m, static friction that lets the hub swing
RELEASE_SAMPLES = 1500  # samples of a release: 3 s
RULER_ERROR = 0.03  # relative standard deviation of the deflection that is declared: 1 mm of 30
NAMES = ("total inertia, slews", "payload, slews", "Coulomb friction, decay map")


def solve(seed: int, folder: Path) -> dict:
    """Generates both campaigns and runs the procedures: quantity -> truth, value, standard error and interval."""
    began = time.perf_counter()
    found = {**_slews(seed, folder / "slews"), **_release(seed, folder / "release")}
    return {"found": found, "seconds": time.perf_counter() - began}


def _slews(seed: int, folder: Path) -> dict:
    generator = np.random.default_rng(seed)
    slews = [bang_bang(VirtualRig(), Sensors(), generator, angle) for angle in ANGLES]
    truth = make_campaign(folder, {}, seed, perturb=1.0, experiments=slews, force=True).true
    campaign = read_campaign(folder)
    true = campaign.rig.replace("true", **truth)
    model = Model(true, campaign.sensors, chain.fit_shape(true, 5), step=2e-3)
    prepared = _prepared(campaign)
    data = DrivenData.of(prepared, model, joint.BANDS)
    whole = total_inertia.momentum_balance(data, model)
    if whole is None:
        return {}
    found = {"total inertia, slews": _result(whole.inertia, beam.rigid_inertia(true))}
    hub = balance.hub_balance(data, model, [p.start for p in prepared])
    if hub is not None:
        tip_mass = balance.tip_mass_from_inertias(whole.inertia, hub.inertia, _declared(campaign.rig))
        found["payload, slews"] = _result(tip_mass, true["tip_mass"])
    return found


def _release(seed: int, folder: Path) -> dict:
    rig = VirtualRig(static_positive=STATIC_FRICTION, static_negative=STATIC_FRICTION)
    plan = free_release(rig, Sensors(), np.random.default_rng(seed))
    plan = replace(plan, commands=plan.commands[:RELEASE_SAMPLES])
    truth = make_campaign(folder, {}, seed, rig=rig, perturb=1.0, experiments=[plan], force=True).true
    campaign = _as_declared(read_campaign(folder), np.random.default_rng(seed + 1))
    known = {**truth, "coulomb_friction": campaign.rig["coulomb_friction"]}
    believed = campaign.rig.replace("believed", **known)
    model = Model(believed, campaign.sensors, chain.fit_shape(believed, 12), step=FINE_STEP)
    prepared = _prepared(campaign)
    found = friction_map.friction_map_of_release(model, prepared, [p.start for p in prepared])
    if found is None or found.level is None:
        return {}
    return {"Coulomb friction, decay map": _result(found.level, truth["coulomb_friction"])}


def _as_declared(campaign: Campaign, generator: np.random.Generator) -> Campaign:
    """The campaign with a random error in the declared deflection of the release."""
    off = 1 + RULER_ERROR * generator.standard_normal()
    released = [r.replace(initial_tip_deflection=off * r.initial_tip_deflection) for r in campaign.fit]
    return replace(campaign, fit=tuple(released))


def _prepared(campaign: Campaign) -> list[Prepared]:
    noise = noise_levels(campaign)
    return [prepare(recording, noise)[0] for recording in campaign.fit]


def _declared(rig: Rig) -> dict[str, Estimate]:
    """The declared link parameters that the payload needs, with their standard deviations."""
    names = ("length", "linear_density", "tip_inertia")
    return {name: Estimate(rig[name], joint.prior_deviation(rig, name)) for name in names}


def _result(found: Estimate, true: float) -> dict:
    estimate = {
        "value": found.value,
        "standard_error": found.standard_error,
        "interval": list(found.interval),
    }
    return {"true": true, **estimate}


def table(answers: Sequence[dict]) -> str:
    """Returns bias, error and coverage of each quantity as Markdown; errors are relative."""
    lines = [
        "| quantity | rigs | results | bias | rms error | mean standard error | mean half interval | 95 % coverage |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name in NAMES:
        estimates = [a["found"][name] for a in answers if name in a["found"]]
        if estimates:
            lines.append(_row(name, len(answers), estimates))
    seconds = [a["seconds"] for a in answers]
    lines += [
        "",
        f"Time for both campaigns: median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s.",
    ]
    return "\n".join(lines)


def _row(name: str, rigs: int, estimates: Sequence[dict]) -> str:
    true, value, error = (
        np.array([e[key] for e in estimates]) for key in ("true", "value", "standard_error")
    )
    low, high = np.array([e["interval"] for e in estimates]).T
    off = value / true - 1
    half = (high - low) / 2 / true
    bias = f"{100 * off.mean():.3f} +- {100 * off.std(ddof=1) / np.sqrt(len(off)):.3f} %"
    sizes = (np.sqrt((off**2).mean()), (error / true).mean(), half.mean())
    cells = " | ".join(f"{100 * size:.3f} %" for size in sizes)
    held = np.mean((low <= true) & (true <= high))
    return f"| {name} | {rigs} | {len(estimates)} | {bias} | {cells} | {100 * held:.0f} % |"


def main() -> None:
    """Runs the rigs without an answer and prints the table."""
    parser = resumable.parser(__doc__, jobs=1)
    parser.add_argument("--campaigns", type=int, default=50)
    parser.add_argument("--seed", type=int, default=7000, help="of the first campaign")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.campaigns)
    answers = resumable.answers({str(seed): seed for seed in seeds}, solve, options)
    given = f"--campaigns {options.campaigns} --seed {options.seed}"
    print(f"`python benchmarks/slews.py WORK {given}`, {describe()}, {len(answers)} rigs\n")
    print(table(answers))


if __name__ == "__main__":
    main()
