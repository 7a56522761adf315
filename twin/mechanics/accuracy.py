"""The chain compared with the analytical model: modes, statics, friction, with an error bound for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import mujoco
import numpy as np

from twin import labels
from twin.errors import InputError
from twin.mechanics import beam, mjcf
from twin.mechanics.beam import Boundary
from twin.mechanics.chain import DEFAULT_SEGMENTS, Chain, build
from twin.mechanics.chain_modes import ModeComparison, compare_modes, linearised
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.plant import Plant, declared_plant
from twin.parameters import Rig

SEGMENT_LIMITS = (2, 48)
"""Fewest and most segments of a chain that can be checked."""


@dataclass(frozen=True)
class Row:
    """One comparison: error and its bound, both in `unit`."""

    quantity: str
    error: float
    bound: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the size of the error is within its bound; False for NaN."""
        return bool(abs(self.error) <= self.bound)


@dataclass(frozen=True)
class Check:
    """Results of all comparisons, SI units unless stated.

    Attributes:
      rig: its name.
      segments: number of hinges.
      free, clamped: modes with the hub free to turn and locked.
      compliance: static tip deflection per force [m/N], analytical and of the chain.
      creep: rotation of the hub in 60 s under 92 % of its static friction [rad]; None without friction.
      break_away: torque of a slow ramp at which the hub starts to move [N m]; declared and simulated.
      step_change: change of the final angle of a slew with sticking as the time step is halved, and halved again [rad].
      rows: errors with their bounds.
    """

    rig: str
    segments: int
    free: ModeComparison
    clamped: ModeComparison
    compliance: tuple[float, float]
    creep: float | None
    break_away: tuple[float, float] | None
    step_change: tuple[float, float] | None
    rows: tuple[Row, ...]

    @property
    def passed(self) -> bool:
        """Whether every error is within its bound."""
        return all(row.passed for row in self.rows)


def check(
    rig: Rig, segments: int = DEFAULT_SEGMENTS, report: Callable[[str], None] = lambda text: None
) -> Check:
    """Compares a rig's chain with its analytical model.

    Args:
      rig: the rig.
      segments: number of hinges of the chain.
      report: called with the name of each stage, for a progress display.

    Raises:
      InputError: the number of segments is outside `SEGMENT_LIMITS`.
    """
    if not SEGMENT_LIMITS[0] <= segments <= SEGMENT_LIMITS[1]:
        raise InputError(f"--segments is {segments}; expected {SEGMENT_LIMITS[0]} to {SEGMENT_LIMITS[1]}")
    report(f"fitting a chain of {segments} segments")
    chain = build(rig, segments)
    plant = declared_plant(rig, chain)
    report("eigenvalues and ring-downs")
    free, clamped = (compare_modes(rig, chain, plant, boundary) for boundary in get_args(Boundary))
    compliance = (beam.static_tip_compliance(rig), _tip_compliance(rig, chain, plant))
    creep = break_away = step_change = None
    if plant.friction.static_positive > 0:
        report("60 s under a torque that static friction holds")
        creep = _creep(rig, chain, plant)
        break_away = (plant.friction.static_positive, _break_away(rig, chain, plant))
        report("a slew with three time steps")
        step_change = _step_change(rig, chain, plant)
    rows = _bounded_errors(free, clamped, compliance, creep, break_away, step_change)
    return Check(rig.name, segments, free, clamped, compliance, creep, break_away, step_change, tuple(rows))


def to_json(result: Check, published_hz: Sequence[float]) -> dict[str, Any]:
    """Returns what `twin check --json` writes.

    Args:
      result: the comparison.
      published_hz: published frequencies of the first two free modes [Hz].
    """
    pairs = {"free": result.free, "clamped": result.clamped}
    f1, f2 = published_hz
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


# Statics and friction


def _tip_compliance(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Deflection of MuJoCo's site `tip` per transverse force on it, hub locked [m/N]."""
    model = mjcf.dynamics_spec(chain, plant, rig, locked="hub").compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, jacobian, None, model.site("tip").id)
    stiffness = linearised(model)[2]
    return float(jacobian[1] @ np.linalg.solve(stiffness, jacobian[1]))


def _creep(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Rotation of the hub [rad] in 60 s under 0.06/0.065 of its static friction, so 0.06 N m on `bossi2009`."""
    engine = MujocoChain(rig, chain, plant)
    engine.advance(0.06 / 0.065 * plant.friction.static_positive, 60.0)
    return float(abs(engine.angles[0]))


def _break_away(rig: Rig, chain: Chain, plant: Plant) -> float:
    """Torque [N m] at which the hub starts to move under a ramp of 1e-3 of the static friction per second."""
    engine = MujocoChain(rig, chain, plant)
    for torque in plant.friction.static_positive * np.arange(0.99, 1.01, 1e-5):
        engine.advance(torque, 0.01)
        if engine.mode != 0:
            return float(torque)
    return float("nan")


def _step_change(rig: Rig, chain: Chain, plant: Plant) -> tuple[float, float]:
    """Change [rad] of a slew's final angle as the time step is halved, and halved again.

    The slew is a bang-bang torque of 70 % of the torque limit, or three times the static friction if that is less,
    which turns the frictionless rigid rig by 90 degrees; then no torque until the hub rests.
    """
    limit = rig.get("torque_limit", np.inf)
    torque = min(0.7 * limit, 3 * plant.friction.static_positive)
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


# Bounds


def _bounded_errors(
    free: ModeComparison,
    clamped: ModeComparison,
    compliance: tuple[float, float],
    creep: float | None,
    break_away: tuple[float, float] | None,
    step_change: tuple[float, float] | None,
) -> list[Row]:
    """Errors with their bounds; arguments are attributes of `Check`."""
    rows = []
    for name, table in (("free", free), ("clamped", clamped)):
        for i, (exact, chained) in enumerate(zip(table.analytical, table.chain, strict=True), start=1):
            rows.append(Row(f"f{i} {name}", _percent(chained, exact), 0.01, "%"))
    for name, table in (("free", free), ("clamped", clamped)):
        error = _percent(table.simulated[0], table.analytical[0])
        rows.append(Row(f"f1 {name}, ring-down", error, 0.1, "%"))
    for name, table in (("free", free), ("clamped", clamped)):
        if table.analytical_damping[0] > 0:
            for source, ratios in (("", table.chain_damping), (", ring-down", table.simulated_damping)):
                error = _percent(ratios[0], table.analytical_damping[0])
                rows.append(Row(f"damping of mode 1 {name}{source}", error, 3.0, "%"))
    shape = float(1 - min(free.mac.min(), clamped.mac.min()))
    rows.append(Row("mode shapes, 1 − MAC", shape, 0.01, "1"))
    rows.append(Row("static tip compliance", _percent(compliance[1], compliance[0]), 0.2, "%"))
    if creep is not None and break_away is not None and step_change is not None:
        rows.append(Row("creep in 60 s below break-away", creep, 1e-6, "rad"))
        rows.append(Row("break-away torque", break_away[1] - break_away[0], 0.003 * break_away[0], "N*m"))
        rows.append(Row("slew, time step halved", step_change[0], 1e-3, "rad"))
    return rows


def _percent(value: float, reference: float) -> float:
    """Relative error [%]."""
    return float(100 * (value / reference - 1))


def text_rows(result: Check) -> list[tuple[str, ...]]:
    """Returns the rows of the printed table: mode, analytical, chain, simulated [Hz], damping of each, 1 − MAC."""
    rows = []
    tables: Mapping[str, ModeComparison] = {"free": result.free, "clamped": result.clamped}
    for name, t in tables.items():
        for i in range(len(t.analytical)):
            frequencies = (t.analytical[i], t.chain[i], t.simulated[i])
            ratios = (t.analytical_damping[i], t.chain_damping[i], t.simulated_damping[i])
            cells = [f"{f:.5f}" for f in frequencies] + [f"{z:.5f}" for z in ratios]
            rows.append((f"{i + 1} {name}", *cells, labels.number(1 - t.mac[i], 2)))
    return rows
