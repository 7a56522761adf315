"""Error and time of runs with play, by the swing of the motor on a flank below which the contact is not resolved.

    python benchmarks/contact.py [SWING ...]

SWING is `planar.SETTLED_SWING`: an amplitude over the depth of the contact [1]; 0 resolves every contact. The error is
the largest one of the hub angle up to an instant, against steps 16 times shorter, as the geometric mean over the runs.
Each swing has a process of its own, in which the equations are compiled with it: less than a minute. The table is
printed.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np
from machine import command, describe

from twin.mechanics import planar
from twin.mechanics.chain import build
from twin.mechanics.plant import declared_plant
from twin.rigs import preset

SWINGS = (0.0, planar.SETTLED_SWING, 0.02, 0.1)
INSTANTS = (1.0, 2.0, 6.0)  # s
FLANKS = (  # gap [rad], stiffness [N m/rad], damping ratio [1], friction on the motor
    (0.02, 400.0, 0.3, True),
    (0.02, 400.0, 0.3, False),
    (0.01, 2000.0, 0.1, True),
    (0.03, 100.0, 1.0, False),
    (0.02, 400.0, 0.05, False),
)
_STEP, _FINER, _ROUNDS = 1e-3, 16, 5


def commands() -> tuple[np.ndarray, list[np.ndarray]]:
    """Instants [s] and four commands [N m]: a square wave, a sweep, a noisy sine and a decaying one."""
    t = np.arange(0.0, INSTANTS[-1], 0.01)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    return t, [
        0.1 * np.sign(np.sin(2 * np.pi * 0.5 * t)),
        0.1 * np.sin(2 * np.pi * (0.2 + 0.1 * t) * t),
        0.1 * np.sin(2 * np.pi * 0.4 * t) + noise,
        0.06 * np.sin(2 * np.pi * 0.7 * t) * np.exp(-0.1 * t) + 0.03 * np.sign(np.sin(2 * np.pi * 0.3 * t)),
    ]


def measured() -> dict[str, list[float]]:
    """Errors [rad] up to each instant, as the mean over all runs, and the processor time of all runs [s]."""
    rig = preset("bossi2009")
    links = build(rig).with_slower_modes(_STEP)
    rest, row = np.zeros(len(links.lengths) + 1), np.arange(0.0, INSTANTS[-1], 2e-3)
    plain = declared_plant(rig, links)
    times, torques = commands()
    errors, spent = [], 0.0
    for (gap, stiffness, loss, on_motor), torque in itertools.product(FLANKS, torques):
        plant = plain.with_backlash(gap, 0.4 * rig["hub_inertia"], stiffness, loss, on_motor)
        fine = plant.with_motor(contact_step=plant.motor.contact_step / _FINER)
        run = (times, torque, row, rest, rest, 0, False)
        reference, found = (planar.simulate(p, *run, h)[0] for p, h in ((fine, _STEP / 10), (plant, _STEP)))
        off = np.maximum.accumulate(np.abs(found - reference)[:, 0])
        errors.append(off[np.searchsorted(row, INSTANTS) - 1])
        spent += min(_seconds(plant, run) for _ in range(_ROUNDS))
    means = np.exp(np.log(np.maximum(errors, 1e-9)).mean(axis=0))
    return {"errors": means.tolist(), "seconds": [spent]}


def _seconds(plant: planar.Plant, run: tuple) -> float:
    began = time.process_time()
    planar.simulate(plant, *run, _STEP)
    return time.process_time() - began


def in_its_own_process(swing: float) -> dict[str, list[float]]:
    """What `measured` returns with equations that are compiled with this swing."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        call = [sys.executable, __file__, "--measure", repr(swing)]
        done = subprocess.run(call, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def main() -> None:
    """Prints the table, or with --measure the figures of one swing as JSON."""
    if sys.argv[1:2] == ["--measure"]:
        planar.SETTLED_SWING = float(sys.argv[2])
        print(json.dumps(measured()))
        return
    swings = [float(text) for text in sys.argv[1:]] or SWINGS
    found = {swing: in_its_own_process(swing) for swing in swings}
    first = next(iter(found.values()))["seconds"][0]
    print(f"`{command()}`, {describe()}, {len(FLANKS) * len(commands()[1])} runs of {INSTANTS[-1]:g} s\n")
    print(
        "| swing | " + " | ".join(f"error up to {t:g} s [rad]" for t in INSTANTS) + " | time over the first |"
    )
    print("| ---: |" + " ---: |" * (len(INSTANTS) + 1))
    for swing, one in found.items():
        cells = [f"{error:.1e}" for error in one["errors"]]
        print(f"| {swing:g} | {' | '.join(cells)} | {one['seconds'][0] / first:.2f} |", flush=True)


if __name__ == "__main__":
    main()
