"""Frequencies and a slew of the flexible link against cost, beside the beams of other programs.

The rig without friction and damping, as none of the others has this rig's stick and slip. Beside twin's fitted chain:

    Exudyn         ANCF cable elements in the plane; hub and payload as masses on the end nodes' positions and slopes;
                   trapezoidal rule with modified Newton, built without range checks: its cheapest settings of those
                   tried. Its explicit solvers need steps of 0.03 ms, because cables stretch.
    MuJoCo cable   `mujoco.elasticity.cable` as its composite makes it, the first body fixed to the hub; and, shifted,
                   with half a body at each end, so that the hinges are where a uniform chain has them. RK4, no twist.

Frequencies are those of the linearised model times what the time step does to them: tan for the trapezoidal rule, the
argument of the amplification for RK4. The step is the largest part of a sample period (2 ms) that is stable and leaves
f1 to f3, free and clamped, within 0.1 %; where the elements alone do not, that changes their frequencies by less. A
slew that is off by a radian diverged: its step is stable for a straight cable in the plane. The trajectory, hub angle
of the quarter turn of `frequencies.py`, is compared with a fitted chain of 24 segments. Cost is processor time per
simulated second; all models of a row's size run in turn.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from typing import NamedTuple

import machine
import mujoco
import numpy as np
from frequencies import DURATION, Slew, slew
from scipy.linalg import eigh

from twin.mechanics import beam, planar
from twin.mechanics.chain import build
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import declared_plant
from twin.parameters import Rig
from twin.rigs import preset

SIZES = (4, 5, 6, 8, 12, 16, 24, 32)
REFERENCE = 24  # segments of the reference trajectory
WITHIN = 1e-3  # [1], of f1 to f3
CLOSE = 0.5  # mrad, RMS of the slew
SAMPLE = 2e-3  # s
STABLE = 2.55  # [1], RK4: step times the highest frequency
AXIAL_STIFFNESS = 1e5  # N, of the ANCF cable: the payload's centrifugal force stretches it by 1e-5
CABLE_RADIUS = 2e-3  # m, of the capsules of MuJoCo's cable; only the product with the modulus matters
ROUNDS = 7  # of timing, up to 8 elements; one above

Boundaries = tuple[np.ndarray, np.ndarray]


class Model(NamedTuple):
    """A discretised rig: name, frequencies free and clamped [rad/s], time step [s], and its slew: hub angle [rad]."""

    name: str
    frequencies: Boundaries
    step: float
    run: Callable[[], np.ndarray]


class Row(NamedTuple):
    """A line of the table: error of f1 to f3 [1], of the slew [mrad], cost [ms per simulated s]."""

    name: str
    elements: int
    error: float
    miss: float
    cost: float


def rk4_rate(phase: np.ndarray) -> np.ndarray:
    """Frequency of an oscillator integrated by RK4 over its own, by frequency times step [1]."""
    z = 1j * phase
    return np.angle(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) / phase


def trapezoidal_rate(phase: np.ndarray) -> np.ndarray:
    """Frequency of an oscillator integrated by the trapezoidal rule over its own [1]."""
    return 2 * np.arctan(phase / 2) / phase


def error(rig: Rig, frequencies: Boundaries, rate: Callable[[np.ndarray], np.ndarray], step: float) -> float:
    """Largest relative error of f1 to f3, free and clamped, elements and time step together [1]."""
    exact = (beam.modes(rig, 3, boundary).frequencies for boundary in ("free", "clamped"))
    return max(
        float(np.abs(f[:3] * rate(f[:3] * step) / e - 1).max())
        for f, e in zip(frequencies, exact, strict=True)
    )


def step_of(
    rig: Rig, frequencies: Boundaries, rate: Callable[[np.ndarray], np.ndarray], stable: float
) -> float:
    """Largest stable part of a sample period with which the error, or that of the step alone, is within the bound."""
    parts = [SAMPLE / k for k in range(1, 129) if SAMPLE / k <= stable]
    right = [h for h in parts if error(rig, frequencies, rate, h) <= WITHIN]
    lowest = np.concatenate([f[:3] for f in frequencies])
    return (right or [h for h in parts if np.abs(rate(lowest * h) - 1).max() <= WITHIN])[0]


def chain_frequencies(mass: np.ndarray, stiffness: np.ndarray) -> Boundaries:
    """Frequencies free (without the rigid turn) and clamped [rad/s]; the hub's coordinate is the first."""
    free = np.sqrt(np.abs(eigh(stiffness, mass, eigvals_only=True)))[1:]
    return free, np.sqrt(eigh(stiffness[1:, 1:], mass[1:, 1:], eigvals_only=True))


def twin_models(rig: Rig, n: int, motion: Slew) -> list[Model]:
    """The fitted chain: compiled equations and MuJoCo."""
    links = build(rig, n)
    frequencies = links.modes("free")[0], links.modes("clamped")[0]
    step = step_of(rig, frequencies, rk4_rate, links.largest_step())
    plant, rest = declared_plant(rig, links), np.zeros(n + 1)
    arguments = (*motion, rest, rest, 0, False, step)
    chain = MujocoChain(rig, links, plant)
    return [
        Model(
            "twin, compiled equations", frequencies, step, lambda: planar.simulate(plant, *arguments)[0][:, 0]
        ),
        Model("twin, MuJoCo chain", frequencies, step, lambda: chain.simulate(*arguments)[0][:, 0]),
    ]


def cable_model(rig: Rig, n: int, motion: Slew, shifted: bool) -> Model:
    """MuJoCo's cable of n bodies, the first fixed to the hub."""
    model = cable_spec(rig, n, shifted).compile()
    frequencies = cable_frequencies(model)
    highest = max(f.max() for f in frequencies)
    step = step_of(rig, frequencies, rk4_rate, STABLE / highest)
    data = mujoco.MjData(model)

    def run() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        angles = np.zeros(len(motion.out))
        for row, start in enumerate(motion.out[:-1]):
            mujoco_steps(model, data, motion, float(start), step)
            angles[row + 1] = data.qpos[0]
        return angles

    return Model("MuJoCo cable, shifted" if shifted else "MuJoCo cable", frequencies, step, run)


def mujoco_steps(model: mujoco.MjModel, data: mujoco.MjData, motion: Slew, start: float, step: float) -> None:
    """Integrates from a sample to the next one, up to and from a change of the torque between them."""
    end = start + SAMPLE
    inside = [float(t) for t in motion.command_time if start + 1e-9 < t < end - 1e-9]
    for a, b in zip([start, *inside], [*inside, end], strict=True):
        data.qfrc_applied[0] = motion.command[np.searchsorted(motion.command_time, a + 1e-9) - 1]
        count = int(np.ceil((b - a) / step - 1e-9))
        model.opt.timestep = (b - a) / count
        mujoco.mj_step(model, data, count)


def cable_spec(rig: Rig, n: int, shifted: bool) -> mujoco.MjSpec:
    """The rig with MuJoCo's composite cable: hub, n bodies, payload; shifted, n + 1 bodies, half ones at both ends."""
    h, bodies = rig["length"] / n, n + 1 if shifted else n
    modulus = rig["bending_stiffness"] / (np.pi * CABLE_RADIUS**4 / 4)
    spec = mujoco.MjSpec.from_string(f"""
      <mujoco>
        <extension><plugin plugin="mujoco.elasticity.cable"/></extension>
        <option integrator="RK4" gravity="0 0 0"><flag constraint="disable" contact="disable"/></option>
        <worldbody>
          <body name="hub">
            <joint name="hub" axis="0 0 1"/>
            <inertial pos="0 0 0" mass="0.6" diaginertia="1 1 {rig["hub_inertia"]}"/>
            <composite type="cable" prefix="" curve="s" count="{bodies + 1} 1 1" size="{bodies * h}" initial="none"
                       offset="{-h / 2 if shifted else 0} 0 0">
              <plugin plugin="mujoco.elasticity.cable">
                <config key="twist" value="0"/><config key="bend" value="{modulus}"/>
              </plugin>
              <joint kind="main" damping="0"/>
              <geom type="capsule" size="{CABLE_RADIUS}" density="1000"/>
            </composite>
          </body>
        </worldbody>
      </mujoco>""")
    half = h / 2 if shifted else 0.0
    names = ["B_first", *(f"B_{i}" for i in range(1, bodies - 1)), "B_last"]
    for name in names:
        start, end = half if name == "B_first" else 0.0, h - half if name == "B_last" else h
        rod_inertia(spec.body(name), rig["linear_density"], start, end)
    tip = spec.body("B_last").add_body(name="tip", pos=[h - half, 0, 0])
    tip.mass, tip.ipos, tip.explicitinertial = rig["tip_mass"], [0, 0, 0], True
    tip.inertia = [rig["tip_inertia"]] * 3
    return spec


def rod_inertia(body: mujoco.MjsBody, density: float, start: float, end: float) -> None:
    """Gives a body the mass of a thin rod along x between two places [m], of a density [kg/m]."""
    mass = density * (end - start)
    body.mass, body.ipos, body.explicitinertial = mass, [(start + end) / 2, 0, 0], True
    across = mass * (end - start) ** 2 / 12
    body.inertia, body.iquat = [across / 100, across, across], [1, 0, 0, 0]


def cable_frequencies(model: mujoco.MjModel) -> Boundaries:
    """Frequencies of the straight cable in the plane [rad/s], stiffness by differences of the passive forces."""
    data, nv = mujoco.MjData(model), model.nv
    plane = [0, *range(3, nv, 3)]  # z of the hub's hinge and of each ball joint
    columns, change = [], 1e-5  # rad
    for place in plane:
        forces = []
        for sign in (1, -1):
            mujoco.mj_resetData(model, data)
            direction = np.zeros(nv)
            direction[place] = sign
            mujoco.mj_integratePos(model, data.qpos, direction, change)
            mujoco.mj_forward(model, data)
            forces.append(data.qfrc_passive[plane].copy())
        columns.append((forces[1] - forces[0]) / (2 * change))
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    mass = np.zeros((nv, nv))
    mujoco.mj_fullM(model, data, mass)
    stiffness = np.array(columns)
    return chain_frequencies(mass[np.ix_(plane, plane)], (stiffness + stiffness.T) / 2)


class Cable(NamedTuple):
    """Exudyn's system with the numbers of its torque load and of its sensor of the hub's slope."""

    container: object
    system: object
    load: int
    sensor: int


def exudyn_cable(rig: Rig, n: int, clamped: bool = False) -> Cable:
    """The rig with n ANCF cable elements."""
    exu, items, beams = (
        machine.peer(f"exudyn{part}", "exudyn==1.13.6") for part in ("", ".itemInterface", ".beams")
    )
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    template = items.Cable2D(
        physicsMassPerLength=rig["linear_density"],
        physicsBendingStiffness=rig["bending_stiffness"],
        physicsAxialStiffness=AXIAL_STIFFNESS,
        useReducedOrderIntegration=1,
    )
    held = [1, 1, 0, 1 if clamped else 0]
    nodes, cables, *_ = beams.GenerateStraightLineANCFCable2D(
        mbs, [0, 0, 0], [rig["length"], 0, 0], n, template, fixedConstraintsNode0=held
    )
    # On a slope of unit length, 1/2 J (x'^2 + y'^2) of its rates is the kinetic energy of a rotating body.
    ends = ((nodes[0], 0.0, rig["hub_inertia"]), (nodes[-1], rig["tip_mass"], rig["tip_inertia"]))
    for node, mass, inertia in ends:
        mbs.AddObject(
            items.ObjectGenericODE2(nodeNumbers=[node], massMatrix=np.diag([mass] * 2 + [inertia] * 2))
        )
    root = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=cables[0], localPosition=[0, 0, 0]))
    load = mbs.AddLoad(items.Torque(markerNumber=root, loadVector=[0, 0, 0]))
    kind = exu.OutputVariableType.Coordinates
    sensor = mbs.AddSensor(
        items.SensorNode(nodeNumber=nodes[0], outputVariableType=kind, storeInternal=True, writeToFile=False)
    )
    mbs.Assemble()
    return Cable(container, mbs, load, sensor)


def exudyn_frequencies(rig: Rig, n: int, clamped: bool) -> np.ndarray:
    """The three lowest frequencies of bending [rad/s]; those of stretching are all above them."""
    squared, _ = exudyn_cable(rig, n, clamped).system.ComputeODE2Eigenvalues()
    found = np.sqrt(np.abs(squared))
    return found[0 if clamped else 1 :][:3]


def exudyn_model(rig: Rig, n: int, motion: Slew) -> Model:
    """Exudyn's cable with the trapezoidal rule."""
    frequencies = exudyn_frequencies(rig, n, False), exudyn_frequencies(rig, n, True)
    step = step_of(rig, frequencies, trapezoidal_rate, SAMPLE)
    return Model(
        "Exudyn, ANCF cable", frequencies, step, lambda: exudyn_slew(exudyn_cable(rig, n), motion, step)
    )


def exudyn_slew(cable: Cable, motion: Slew, step: float) -> np.ndarray:
    """Hub angle of the slew [rad]: a run for each value of the torque."""
    exu, mbs = machine.peer("exudyn", "exudyn==1.13.6"), cable.system
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = SAMPLE
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.linearSolverType = exu.LinearSolverType.EigenDense
    rows = []
    for start, end, torque in zip(
        motion.command_time, [*motion.command_time[1:], DURATION], motion.command, strict=True
    ):
        mbs.SetLoadParameter(cable.load, "loadVector", [0, 0, torque])
        settings.timeIntegration.startTime, settings.timeIntegration.endTime = start, end
        settings.timeIntegration.numberOfSteps = int(np.ceil((end - start) / step))
        solver = exu.DynamicSolverType.TrapezoidalIndex2
        mbs.SolveDynamic(settings, solverType=solver, updateInitialValues=True)
        rows.append(np.array(mbs.GetSensorStoredData(cable.sensor)))
    seen = np.vstack(rows)  # time, then displacements of x, y and of the slope x', y'
    return np.interp(motion.out, seen[:, 0], np.unwrap(np.arctan2(seen[:, 4], 1 + seen[:, 3])))


def models(rig: Rig, n: int, motion: Slew) -> list[tuple[Model, Callable[[np.ndarray], np.ndarray]]]:
    """All models of a size, each with what its integrator does to frequencies."""
    ours = [(model, rk4_rate) for model in twin_models(rig, n, motion)]
    cables = [(cable_model(rig, n, motion, shifted), rk4_rate) for shifted in (False, True)]
    return [*ours, (exudyn_model(rig, n, motion), trapezoidal_rate), *cables]


def main() -> None:
    """Prints the table, and the cheapest of each model that has f1 to f3 within the bound."""
    sys.exudynFast = True  # type: ignore[attr-defined]  # without range checks
    warnings.simplefilter("ignore", DeprecationWarning)
    machine.peer("exudyn", "exudyn==1.13.6")
    rig = preset("bossi2009").replace(
        source="benchmark", static_friction=0, coulomb_friction=0, damping_ratio=0
    )
    motion = slew(rig)
    truth = twin_models(rig, REFERENCE, motion)[0].run()
    print(f"`{machine.command()}` on {machine.describe()}, exudyn {machine.version('exudyn')}\n")
    rows: list[Row] = []
    print("| model | elements | f1-f3 error % | step ms | slew, RMS mrad | CPU ms per s |")
    print("| --- " + "| ---: " * 5 + "|")
    for n in SIZES:
        both = models(rig, n, motion)
        rounds = ROUNDS if n <= 8 else 1
        costs = np.median(machine.paired([m.run for m, _ in both], rounds), axis=0) / DURATION
        for (model, rate), cost in zip(both, costs, strict=True):
            off = error(rig, model.frequencies, rate, model.step)
            miss = 1e3 * np.sqrt(np.mean((model.run() - truth) ** 2))
            cells = f"{100 * off:.4f} | {1e3 * model.step:.3f} | {miss:.2f} | {1e3 * cost:.2f}"
            print(f"| {model.name} | {n} | {cells} |", flush=True)
            rows.append(Row(model.name, n, off, miss, 1e3 * cost))
    print_cheapest(f"f1 to f3 within {100 * WITHIN} %", [r for r in rows if r.error <= WITHIN])
    print_cheapest(f"the slew within {CLOSE} mrad", [r for r in rows if r.miss <= CLOSE])


def print_cheapest(condition: str, rows: list[Row]) -> None:
    """Prints the cheapest row of each model among those that meet a condition."""
    best = min(r.cost for r in rows if not r.name.startswith("twin"))
    print(f"\nCheapest with {condition}:\n")
    print("| model | elements | CPU ms per s | over the cheapest of the others |")
    print("| --- | ---: | ---: | ---: |")
    for name in dict.fromkeys(r.name for r in rows):
        r = min((r for r in rows if r.name == name), key=lambda r: r.cost)
        print(f"| {name} | {r.elements} | {r.cost:.2f} | {r.cost / best:.3f} |")


if __name__ == "__main__":
    main()
