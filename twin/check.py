"""The chain held against the analytical model: frequencies, damping, shapes, statics, friction.

`chain` values are eigenvalues of MuJoCo's own mass matrix and forces, differenced about the straight link;
`simulated` ones are fitted to small ring-downs that MuJoCo's RK4 integrates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import mujoco
import numpy as np
from scipy.linalg import eig, eigh
from scipy.optimize import least_squares

from twin import beam, mjcf, modal, planar
from twin.beam import Boundary
from twin.chain import DEFAULT_SEGMENTS, Chain, build
from twin.errors import InputError
from twin.mujoco_chain import MujocoChain
from twin.parameters import Rig
from twin.planar import Plant
from twin.rigs import bossi2009

SEGMENTS = (2, 48)
"""Fewest and most segments that can be asked for."""

_MODES = 3
_RING_DOWN_TIP = 1e-4  # m; large enough for rounding, small enough for the link to stay linear
_RING_DOWN_PERIODS = 12


@dataclass(frozen=True)
class Table:
    """Frequencies [Hz], damping ratios [1] and shape agreement of one boundary condition; n modes each.

    Attributes:
      analytical: exact frequencies; chain: MuJoCo's, linearised; simulated: of ring-downs.
      analytical_damping, chain_damping, simulated_damping: the same of damping ratios.
      mac: modal assurance criterion (a.b)^2 / (a.a b.b) of the deflections along the link.
    """

    analytical: np.ndarray
    chain: np.ndarray
    simulated: np.ndarray
    analytical_damping: np.ndarray
    chain_damping: np.ndarray
    simulated_damping: np.ndarray
    mac: np.ndarray


@dataclass(frozen=True)
class Row:
    """One verdict: how far off, in `unit`, and how far it may be."""

    quantity: str
    error: float
    bound: float
    unit: str

    @property
    def passed(self) -> bool:
        """The error is a number within its bound."""
        return bool(abs(self.error) <= self.bound)


@dataclass(frozen=True)
class Check:
    """Everything that was compared, SI units unless said.

    Attributes:
      rig: its name.
      segments: number of hinges.
      free, clamped: modes with the hub free to turn and locked.
      compliance: static tip deflection per force [m/N], analytical and of the chain.
      creep: what the hub moves under 92 % of its static friction in 60 s [rad]; None without friction.
      break_away: torque of a slow ramp at which the hub starts to move [N m]; declared and found.
      step_change: by how much a slew with sticking ends elsewhere when the time step is halved, twice [rad].
      rows: verdicts.
    """

    rig: str
    segments: int
    free: Table
    clamped: Table
    compliance: tuple[float, float]
    creep: float | None
    break_away: tuple[float, float] | None
    step_change: tuple[float, float] | None
    rows: tuple[Row, ...]

    @property
    def passed(self) -> bool:
        """Every verdict is positive."""
        return all(row.passed for row in self.rows)


def check(
    rig: Rig, segments: int = DEFAULT_SEGMENTS, report: Callable[[str], None] = lambda text: None
) -> Check:
    """Compares a rig's chain with its analytical model.

    Args:
      rig: the rig.
      segments: number of hinges of the chain.
      report: called with what is being done, for a progress display.

    Raises:
      InputError: no chain with so many segments.
    """
    if not SEGMENTS[0] <= segments <= SEGMENTS[1]:
        raise InputError(f"--segments is {segments}; expected {SEGMENTS[0]} to {SEGMENTS[1]}")
    report(f"fitting a chain of {segments} segments")
    chain = build(rig, segments)
    plant = planar.declared_plant(rig, chain)
    report("eigenvalues and ring-downs")
    free, clamped = (_compare(rig, chain, plant, boundary) for boundary in get_args(Boundary))
    compliance = (beam.static_tip_compliance(rig), _tip_compliance(rig, chain, plant))
    creep = break_away = step_change = None
    if plant.static_positive > 0:
        report("60 s under a torque that static friction holds")
        creep = _creep(rig, chain, plant)
        break_away = (plant.static_positive, _break_away(rig, chain, plant))
        report("a slew with three time steps")
        step_change = _step_change(rig, chain, plant)
    rows = _verdicts(free, clamped, compliance, creep, break_away, step_change)
    return Check(rig.name, segments, free, clamped, compliance, creep, break_away, step_change, tuple(rows))


def to_json(result: Check) -> dict[str, Any]:
    """Returns what `twin check --json` writes."""
    pairs = {"free": result.free, "clamped": result.clamped}
    f1, f2 = bossi2009.FREQUENCIES_HZ
    return {
        "rig": result.rig,
        "segments": result.segments,
        "frequencies_hz": {
            name: {
                "analytical": t.analytical.tolist(),
                "chain": t.chain.tolist(),
                "simulated": t.simulated.tolist(),
            }
            for name, t in pairs.items()
        },
        "damping_ratio": {
            name: {
                "analytical": t.analytical_damping.tolist(),
                "chain": t.chain_damping.tolist(),
                "simulated": t.simulated_damping.tolist(),
            }
            for name, t in pairs.items()
        },
        "mac": {name: t.mac.tolist() for name, t in pairs.items()},
        "static_tip_compliance": dict(zip(("analytical", "chain"), result.compliance, strict=True)),
        "creep_rad": result.creep,
        "break_away_nm": result.break_away
        and dict(zip(("declared", "found"), result.break_away, strict=True)),
        "step_change_rad": result.step_change,
        "bounds": [
            {"quantity": r.quantity, "error": r.error, "bound": r.bound, "unit": r.unit, "passed": r.passed}
            for r in result.rows
        ],
        "published": {"f1_hz": f1, "f2_hz": f2},
        "passed": result.passed,
    }


# Modes


def _compare(rig: Rig, chain: Chain, plant: Plant, boundary: Boundary) -> Table:
    count = min(_MODES, chain.shape.segments)
    exact = beam.modes(rig, count, boundary)
    model = mjcf.dynamics_spec(chain, _without_friction(plant), rig, boundary == "clamped").compile()
    mass, damping, stiffness = linearised(model)
    roots = _roots(mass, damping, stiffness)[:count]
    shapes = _shapes(mass, stiffness, boundary)[:, :count]
    rings = [_ring_down(model, chain, shapes[:, i], exact.frequencies[i], boundary) for i in range(count)]
    ratios = np.full(count, rig["damping_ratio"])
    if boundary == "clamped":
        ratios = modal.clamped_damping_ratios(rig, count)
    return Table(
        exact.frequencies / (2 * np.pi),
        np.abs(roots) / (2 * np.pi),
        np.array([omega for omega, _ in rings]) / (2 * np.pi),
        ratios,
        -roots.real / np.abs(roots),
        np.array([ratio for _, ratio in rings]),
        _assurance(exact, chain, shapes, boundary),
    )


def _without_friction(plant: Plant) -> Plant:
    return plant._replace(
        static_positive=0.0, static_negative=0.0, coulomb_positive=0.0, coulomb_negative=0.0
    )


def linearised(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns M, D and K (nv x nv each) of M q'' + D q' + K q = 0 about the model's zero position.

    M is MuJoCo's mass matrix; D and K are central differences of its smooth forces.
    """
    data, size = mujoco.MjData(model), model.nv

    def forces(qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        return data.qfrc_smooth.copy()

    zero, step = np.zeros(size), 1e-6
    nudges = step * np.eye(size)
    stiffness = np.array([forces(-e, zero) - forces(e, zero) for e in nudges]).T / (2 * step)
    damping = np.array([forces(zero, -e) - forces(zero, e) for e in nudges]).T / (2 * step)
    forces(zero, zero)
    return _mass_matrix(model, data), (damping + damping.T) / 2, (stiffness + stiffness.T) / 2


def _mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """MuJoCo's mass matrix (nv x nv) at the position last computed, column by column."""
    columns = np.zeros((model.nv, model.nv))
    for column, unit in zip(columns, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return columns.T


def _roots(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Eigenvalues of the oscillating modes, one of each pair, slowest first."""
    size = len(mass)
    top = np.hstack([np.zeros((size, size)), np.eye(size)])
    system = np.vstack([top, -np.linalg.solve(mass, np.hstack([stiffness, damping]))])
    roots = eig(system, right=False)
    roots = roots[roots.imag > 1e-6 * np.abs(roots).max()]
    return roots[np.argsort(np.abs(roots))]


def _shapes(mass: np.ndarray, stiffness: np.ndarray, boundary: Boundary) -> np.ndarray:
    """Hub and hinge angles of each flexible mode (n + 1 x n), any scale."""
    vectors = eigh(stiffness, mass)[1]
    if boundary == "free":
        return vectors[:, 1:]
    return np.vstack([np.zeros(vectors.shape[1]), vectors])


def _deflections(chain: Chain) -> np.ndarray:
    """Turns joint angles (n + 1), small, into deflections of hinges and tip (n + 1 x n + 1) [m/rad]."""
    ends = np.cumsum(chain.lengths)
    starts = np.concatenate([[0.0], chain.hinges])
    return np.tril(ends[:, None] - starts)


def _assurance(exact: beam.Modes, chain: Chain, shapes: np.ndarray, boundary: Boundary) -> np.ndarray:
    """MAC of the deflections along the link, at 200 places; a chain is straight between its hinges."""
    places = np.linspace(0, exact.length, 200)
    ends = np.concatenate([[0.0], np.cumsum(chain.lengths)])
    reference = exact.shape(places).T
    corners = _deflections(chain) @ shapes
    deflections = np.column_stack([np.interp(places, ends, np.append(0.0, column)) for column in corners.T])
    products = np.sum(reference * deflections, axis=0) ** 2
    return products / (np.sum(reference**2, axis=0) * np.sum(deflections**2, axis=0))


def _ring_down(
    model: mujoco.MjModel, chain: Chain, shape: np.ndarray, omega: float, boundary: Boundary
) -> tuple[float, float]:
    """Releases the link in one mode's shape; returns frequency [rad/s] and damping ratio [1] of the motion.

    Args:
      model: with the hub's joint, or locked.
      chain: its chain.
      shape: joint angles (n + 1), any scale.
      omega: about what to expect [rad/s].
      boundary: which model it is.
    """
    shape = shape * _RING_DOWN_TIP / np.abs(_deflections(chain) @ shape).max()
    data = mujoco.MjData(model)
    start = shape if boundary == "free" else shape[1:]
    data.qpos[:] = start
    samples = 20 * _RING_DOWN_PERIODS
    interval = _RING_DOWN_PERIODS * 2 * np.pi / omega / samples
    steps = int(np.ceil(interval / chain.largest_step()))
    model.opt.timestep = interval / steps
    # What swings in this mode alone: its momentum is orthogonal to the others'.
    mujoco.mj_forward(model, data)
    mass = _mass_matrix(model, data)
    weights = mass @ start / (start @ mass @ start)
    swing = np.empty(samples)
    for i in range(samples):
        swing[i] = weights @ data.qpos
        mujoco.mj_step(model, data, steps)
    return fit_ring_down(interval * np.arange(samples), swing, omega)


def fit_ring_down(time: np.ndarray, swing: np.ndarray, omega: float) -> tuple[float, float]:
    """Fits exp(-zeta omega t) (a cos omega_d t + b sin omega_d t) + c, omega_d = omega sqrt(1 - zeta^2).

    Args:
      time, swing: (n) instants [s] and values.
      omega: first guess [rad/s].

    Returns:
      omega [rad/s] and zeta [1].
    """

    def residual(z: np.ndarray) -> np.ndarray:
        frequency, ratio = omega * z[0], z[1]
        turn = frequency * np.sqrt(max(1 - ratio**2, 0.0)) * time
        decay = np.exp(-ratio * frequency * time)
        basis = np.column_stack([decay * np.cos(turn), decay * np.sin(turn), np.ones_like(time)])
        return (basis @ np.linalg.lstsq(basis, swing, rcond=None)[0] - swing) / np.abs(swing).max()

    z = least_squares(residual, [1.0, 0.01], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return float(omega * z[0]), float(z[1])


# Statics and friction


def _tip_compliance(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Deflection of MuJoCo's `tip` per force across the link, hub locked [m/N]."""
    model = mjcf.dynamics_spec(chain, plant, rig, locked=True).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("tip").id)
    stiffness = linearised(model)[2]
    return float(jacobian[1] @ np.linalg.solve(stiffness, jacobian[1]))


def _creep(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Angle [rad] the hub turns in 60 s under 0.06 N m where 0.065 hold it, or in proportion."""
    engine = MujocoChain(rig, chain, plant)
    engine.advance(0.06 / 0.065 * plant.static_positive, 60.0)
    return float(abs(engine.angles[0]))


def _break_away(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Torque [N m] at which the hub starts to move while it rises by 1e-3 of the static friction a second."""
    engine = MujocoChain(rig, chain, plant)
    for torque in plant.static_positive * np.arange(0.99, 1.01, 1e-5):
        engine.advance(torque, 0.01)
        if engine.mode != 0:
            return float(torque)
    return float("nan")


def _step_change(rig: Rig, chain: Chain, plant: Plant) -> tuple[float, float]:
    """Change [rad] of a slew's final angle as the step is halved, and halved again.

    A quarter turn of the frictionless rigid rig, at 70 % of the torque limit or three times the static
    friction, and on until it rests.
    """
    limit = rig.get("torque_limit", np.inf)
    torque = min(0.7 * limit, 3 * plant.static_positive)
    half = float(np.sqrt(np.pi / 2 * beam.rigid_inertia(rig) / torque))
    engine = MujocoChain(rig, chain, plant)
    command_time, command = half * np.arange(3.0), torque * np.array([1.0, -1.0, 0.0])
    rest = np.zeros(len(chain.lengths))
    finals = []
    for step in chain.largest_step() / np.array([1, 2, 4]):
        out = np.array([0.0, 4 * half])
        angles, _, _ = engine.simulate(command_time, command, out, rest, rest, h_max=step)
        finals.append(angles[-1, 0])
    return abs(finals[1] - finals[0]), abs(finals[2] - finals[1])


# Verdicts


def _verdicts(
    free: Table,
    clamped: Table,
    compliance: tuple[float, float],
    creep: float | None,
    break_away: tuple[float, float] | None,
    step_change: tuple[float, float] | None,
) -> list[Row]:
    rows = []
    for name, table in (("free", free), ("clamped", clamped)):
        for i, (exact, found) in enumerate(zip(table.analytical, table.chain, strict=True), start=1):
            rows.append(Row(f"f{i} {name}", _percent(found, exact), 0.01, "%"))
    for name, table in (("free", free), ("clamped", clamped)):
        error = _percent(table.simulated[0], table.analytical[0])
        rows.append(Row(f"f1 {name}, ring-down", error, 0.1, "%"))
    for name, table in (("free", free), ("clamped", clamped)):
        if table.analytical_damping[0] > 0:
            for source, found in (("", table.chain_damping), (", ring-down", table.simulated_damping)):
                error = _percent(found[0], table.analytical_damping[0])
                rows.append(Row(f"damping of mode 1 {name}{source}", error, 3.0, "%"))
    shape = float(1 - min(free.mac.min(), clamped.mac.min()))
    rows.append(Row("mode shapes, 1 - MAC", shape, 0.01, "1"))
    rows.append(Row("static tip compliance", _percent(compliance[1], compliance[0]), 0.2, "%"))
    if creep is not None and break_away is not None and step_change is not None:
        rows.append(Row("creep in 60 s below break-away", creep, 1e-6, "rad"))
        rows.append(Row("break-away torque", break_away[1] - break_away[0], 0.003 * break_away[0], "N m"))
        rows.append(Row("slew, time step halved", step_change[0], 1e-3, "rad"))
    return rows


def _percent(found: float, reference: float) -> float:
    return float(100 * (found / reference - 1))


def text_rows(result: Check) -> list[tuple[str, ...]]:
    """Rows of the table of modes: mode, analytical, chain, simulated [Hz], damping of each, 1 - MAC."""
    rows = []
    tables: Mapping[str, Table] = {"free": result.free, "clamped": result.clamped}
    for name, t in tables.items():
        for i in range(len(t.analytical)):
            frequencies = (t.analytical[i], t.chain[i], t.simulated[i])
            ratios = (t.analytical_damping[i], t.chain_damping[i], t.simulated_damping[i])
            cells = [f"{f:.5f}" for f in frequencies] + [f"{z:.5f}" for z in ratios]
            rows.append((f"{i + 1} {name}", *cells, f"{1 - t.mac[i]:.1e}"))
    return rows
