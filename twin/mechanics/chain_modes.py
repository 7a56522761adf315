"""Modes of the chain in MuJoCo compared with those of the exact beam: frequencies, damping, shapes.

`chain` values are eigenvalues of MuJoCo's mass matrix and of its forces linearised about the straight link; `simulated`
values are fitted to free decays of small amplitude, integrated by MuJoCo's RK4.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.linalg import eig, eigh
from scipy.optimize import least_squares

from twin.mechanics import beam, mjcf, modal
from twin.mechanics.beam import Boundary
from twin.mechanics.chain import Chain
from twin.mechanics.plant import Friction, Plant
from twin.parameters import Rig

_MODES = 3  # modes compared per boundary condition
_RING_DOWN_TIP = 1e-4  # m, initial tip deflection: far above rounding, small enough for a linear response
_RING_DOWN_PERIODS = 12  # periods simulated: enough for frequency and damping ratio of a noise-free decay


@dataclass(frozen=True)
class ModeComparison:
    """Modes of one boundary condition (n): of the exact beam, of MuJoCo linearised, of simulated free decays.

    Attributes:
      analytical, chain, simulated: (n) frequencies [Hz].
      analytical_damping, chain_damping, simulated_damping: (n) damping ratios [1].
      mac: (n) modal assurance criterion (a.b)^2 / (a.a b.b) of the deflections along the link.
    """

    analytical: np.ndarray
    chain: np.ndarray
    simulated: np.ndarray
    analytical_damping: np.ndarray
    chain_damping: np.ndarray
    simulated_damping: np.ndarray
    mac: np.ndarray


def compare_modes(rig: Rig, chain: Chain, plant: Plant, boundary: Boundary) -> ModeComparison:
    """Compares the first modes of a chain with those of the exact beam.

    Args:
      rig: the rig.
      chain: its chain.
      plant: its numbers; friction is ignored.
      boundary: whether the hub is free to turn or locked.
    """
    count = min(_MODES, chain.shape.segments)
    exact = beam.modes(rig, count, boundary)
    model = mjcf.dynamics_spec(
        chain, _without_friction(plant), rig, locked="hub" if boundary == "clamped" else ""
    ).compile()
    mass, damping, stiffness = linearised(model)
    roots = _eigenvalues(mass, damping, stiffness)[:count]
    shapes = _mode_shapes(mass, stiffness, boundary)[:, :count]
    rings = [_ring_down(model, chain, shapes[:, i], exact.frequencies[i], boundary) for i in range(count)]
    ratios = np.full(count, rig["damping_ratio"])
    if boundary == "clamped":
        ratios = modal.clamped_damping_ratios(rig, count)
    return ModeComparison(
        exact.frequencies / (2 * np.pi),
        np.abs(roots) / (2 * np.pi),
        np.array([omega for omega, _ in rings]) / (2 * np.pi),
        ratios,
        -roots.real / np.abs(roots),
        np.array([ratio for _, ratio in rings]),
        _modal_assurance(exact, chain, shapes, boundary),
    )


def _without_friction(plant: Plant) -> Plant:
    return plant._replace(friction=Friction())


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


def _eigenvalues(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Eigenvalues [1/s] of the oscillating modes, one of each conjugate pair, by increasing size."""
    size = len(mass)
    top = np.hstack([np.zeros((size, size)), np.eye(size)])
    system = np.vstack([top, -np.linalg.solve(mass, np.hstack([stiffness, damping]))])
    roots = eig(system, right=False)
    roots = roots[roots.imag > 1e-6 * np.abs(roots).max()]
    return roots[np.argsort(np.abs(roots))]


def _mode_shapes(mass: np.ndarray, stiffness: np.ndarray, boundary: Boundary) -> np.ndarray:
    """Hub and hinge angles of each flexible mode (n + 1 x n), of arbitrary scale."""
    vectors = eigh(stiffness, mass)[1]
    if boundary == "free":
        return vectors[:, 1:]
    return np.vstack([np.zeros(vectors.shape[1]), vectors])


def _deflections(chain: Chain) -> np.ndarray:
    """Matrix from small joint angles (n + 1) to deflections of hinges and tip (n + 1 x n + 1) [m/rad]."""
    ends = np.cumsum(chain.lengths)
    starts = np.concatenate([[0.0], chain.hinges])
    return np.tril(ends[:, None] - starts)


def _modal_assurance(exact: beam.Modes, chain: Chain, shapes: np.ndarray, boundary: Boundary) -> np.ndarray:
    """MAC (n) of the deflections at 200 positions along the link; the chain is straight between its hinges."""
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
    """Simulates a free decay from one mode's shape; returns its frequency [rad/s] and damping ratio [1].

    Args:
      model: with the hub's joint, or without it where the hub is clamped.
      chain: its chain.
      shape: joint angles (n + 1), of arbitrary scale.
      omega: approximate frequency [rad/s].
      boundary: of the model.
    """
    shape = shape * _RING_DOWN_TIP / np.abs(_deflections(chain) @ shape).max()
    data = mujoco.MjData(model)
    start = shape if boundary == "free" else shape[1:]
    data.qpos[:] = start
    samples = 20 * _RING_DOWN_PERIODS
    interval = _RING_DOWN_PERIODS * 2 * np.pi / omega / samples
    steps = int(np.ceil(interval / chain.largest_step()))
    model.opt.timestep = interval / steps
    # Modal filter: M times the shape is orthogonal to the other modes.
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
      omega: initial guess [rad/s].

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
