"""How many segments does the chain need? Errors of frequency, statics and trajectory against cost.

A uniform chain (half a segment at each end, whole ones between, k = EI/h) is compared with the fitted one, with 4 to 32
segments, each with its largest stable step in MuJoCo. Frequencies and statics are compared with the exact beam; the
trajectory, a quarter turn by bang-bang torque with sticking, with a uniform chain of 48 segments integrated by
`twin.mechanics.planar` (64 segments differ from it by 0.014 mrad). Cost is processor time per simulated second,
friction included.
"""

from __future__ import annotations

from typing import NamedTuple

import machine
import numpy as np

from twin.mechanics import beam, planar
from twin.mechanics.chain import Chain, build, uniform_shape
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import declared_plant
from twin.parameters import Rig
from twin.rigs import preset

SEGMENTS = (4, 5, 6, 8, 12, 16, 24, 32)
REFERENCE = 48  # segments of the reference trajectory
TORQUE, DURATION = 0.15, 2.5  # N m, s


class Slew(NamedTuple):
    """Command and output times of the trajectory [s], [N m]."""

    command_time: np.ndarray
    command: np.ndarray
    out: np.ndarray


def slew(rig: Rig) -> Slew:
    """Returns a bang-bang torque that turns the rigid, frictionless rig by a quarter, followed by rest."""
    half = np.sqrt(np.pi / 2 * beam.rigid_inertia(rig) / TORQUE)
    command = TORQUE * np.array([1.0, -1.0, 0.0])
    return Slew(half * np.arange(3.0), command, np.arange(0, DURATION, 2e-3))


def errors(rig: Rig, links: Chain) -> tuple[float, float, float, float]:
    """Largest relative errors [1] of f1, of f1 to f3, and of the compliance; highest frequency [Hz]."""
    relative = [
        links.modes(boundary)[0][:3] / beam.modes(rig, 3, boundary).frequencies - 1
        for boundary in ("free", "clamped")
    ]
    first = max(abs(r[0]) for r in relative)
    compliance = abs(links.static_tip_compliance() / beam.static_tip_compliance(rig) - 1)
    return first, float(np.abs(relative).max()), compliance, links.modes()[0][-1] / (2 * np.pi)


def run(rig: Rig, links: Chain, motion: Slew) -> tuple[np.ndarray, float]:
    """Hub angle [rad] in MuJoCo, and processor seconds per simulated second."""
    engine, rest = MujocoChain(rig, links, declared_plant(rig, links)), np.zeros(len(links.lengths))
    repeats = 3 if links.shape.segments <= 8 else 1
    angles, seconds = machine.timed(lambda: engine.simulate(*motion, rest, rest)[0], repeats)
    return angles[:, 0], seconds / DURATION


def reference(rig: Rig, motion: Slew) -> np.ndarray:
    """Hub angle [rad] of the reference chain."""
    links = build(rig, REFERENCE, uniform_shape(REFERENCE))
    rest = np.zeros(len(links.lengths))
    plant = declared_plant(rig, links)
    return planar.simulate(plant, *motion, rest, rest, 0, False, links.largest_step())[0][:, 0]


def main() -> None:
    """Prints the table."""
    rig = preset("bossi2009")
    motion = slew(rig)
    truth = reference(rig, motion)
    print(f"`{machine.command()}` on {machine.describe()}\n")
    print("| chain | segments | f1 error % | f1-f3 error % | compliance error % | highest Hz |", end="")
    print(" step ms | slew, RMS mrad | CPU ms per s | times real time |")
    print("| --- " + "| ---: " * 9 + "|")
    for name in ("uniform", "fitted"):
        for n in SEGMENTS:
            links = build(rig, n, uniform_shape(n) if name == "uniform" else None)
            first, three, compliance, highest = errors(rig, links)
            hub, cost = run(rig, links, motion)
            off = 1e3 * np.sqrt(np.mean((hub - truth) ** 2))
            cells = [name, n, f"{100 * first:.4f}", f"{100 * three:.4f}", f"{100 * compliance:.3f}"]
            cells += [f"{highest:.0f}", f"{1e3 * links.largest_step():.3f}", f"{off:.2f}"]
            cells += [f"{1e3 * cost:.1f}", f"{1 / cost:.3g}"]
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
