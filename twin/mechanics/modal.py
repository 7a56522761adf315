"""The linear model of Bossi et al. 2009, section III, in the exact modes of the link.

    J alpha_tt = tau
    delta_i_tt + 2 zeta omega_i delta_i_t + omega_i^2 delta_i = phi_i'(0) tau

alpha is the angle of the pseudo-pinned frame, delta_i the amplitudes of the modes in it [kg^1/2 m], tau the
torque on the hub, J the inertia of the straight rig about the hub. What is measured:

    hub_angle       theta_hub = alpha + sum_i phi_i'(0) delta_i
    tip_deflection  w_c(l)    = sum_i (phi_i(l) - l phi_i'(0)) delta_i          from the hub's own direction
    strain          h w''(x)  = h sum_i phi_i''(x) delta_i                      h: half thickness at the gauge
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from twin.mechanics.beam import Modes, modes, rigid_inertia, static_tip_compliance
from twin.recording import Sensor

if TYPE_CHECKING:
    import control

# Number of free modes beyond n in which a clamped mode is expanded; the truncation error falls at least as number^-3.
_MODES_FOR_CLAMP = 60


class LinearSystem(Protocol):
    """x_t = A x + B u, y = C x + D u; python-control's StateSpace is one."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def state_space(rig: Mapping[str, float], n: int = 3, gauges: Sequence[Sensor] = ()) -> control.StateSpace:
    """Returns the rig with its hub free to turn, without friction, as a python-control system.

    State [alpha, delta_1..n, alpha_t, delta_1_t..n_t], input torque [N m], outputs hub_angle [rad],
    tip_deflection [m] and the strain [1] at each gauge; all are labelled.

    Args:
      rig: parameters as for `modes`, and damping_ratio [1], that of every mode.
      n: number of modes.
      gauges: strain gauges: channel, position and half thickness.
    """
    flexible = modes(rig, n)
    hub = flexible.shape(0.0, 1)[:, 0]
    tip = flexible.shape(rig["length"])[:, 0] - rig["length"] * hub
    frequencies = np.append(0.0, flexible.frequencies)
    force = np.append(1 / rigid_inertia(rig), hub)
    outputs = {
        "hub_angle": np.append(1.0, hub),
        "tip_deflection": np.append(0.0, tip),
        **{name: np.append(0.0, row) for name, row in _strain_rows(flexible, gauges).items()},
    }
    coordinates = ["alpha", *(f"delta_{i + 1}" for i in range(n))]
    return _second_order(frequencies, rig["damping_ratio"], force, outputs, coordinates, "torque")


def clamped_state_space(
    rig: Mapping[str, float], n: int = 3, gauges: Sequence[Sensor] = (), damping: ArrayLike | None = None
) -> control.StateSpace:
    """Returns the rig with its hub locked as a python-control system.

    State [delta_1..n, delta_1_t..n_t] of the clamped modes, input tip_force [N] on the payload, outputs
    tip_deflection [m] and the strain [1] at each gauge.

    Args:
      rig: parameters as for `state_space`.
      n: number of clamped modes.
      gauges: strain gauges.
      damping: damping ratio of each mode (n) [1]; by default what the losses of the free modes give,
        `clamped_damping_ratios`.
    """
    flexible = modes(rig, n, "clamped")
    tip = flexible.shape(rig["length"])[:, 0]
    ratios = clamped_damping_ratios(rig, n) if damping is None else np.asarray(damping, dtype=float)
    outputs = {"tip_deflection": tip, **_strain_rows(flexible, gauges)}
    coordinates = [f"delta_{i + 1}" for i in range(n)]
    return _second_order(flexible.frequencies, ratios, tip, outputs, coordinates, "tip_force")


def released_state(rig: Mapping[str, float], n: int, deflection: float) -> np.ndarray:
    """Returns the state (2n) of `clamped_state_space` at rest, the tip held aside by a force.

    delta_i = F phi_i(l) / omega_i^2 with F = 3 EI deflection / l^3. The n modes give slightly less than the
    `deflection` [m]: the share of the omitted modes is missing.
    """
    flexible = modes(rig, n, "clamped")
    force = deflection / static_tip_compliance(rig)
    amplitudes = force * flexible.shape(rig["length"])[:, 0] / flexible.frequencies**2
    return np.concatenate([amplitudes, np.zeros(n)])


def clamped_damping_ratios(rig: Mapping[str, float], n: int) -> np.ndarray:
    """Returns the damping ratios (n) [1] of the clamped modes that follow from the losses of the free modes.

    A clamped mode of frequency omega_c is the free rig driven at omega_c by the torque R that holds the hub:

        alpha = -R / (J omega_c^2)        delta_i = R phi_i'(0) / (omega_i^2 - omega_c^2)

    Its modal mass is J alpha^2 + sum_i delta_i^2 and its losses are those of the delta_i, so that, to first
    order in zeta (the coupling of clamped modes by the losses is of second order),

        zeta_c = zeta sum_i omega_i delta_i^2 / (omega_c (J alpha^2 + sum_i delta_i^2))

    zeta = 0.034 in every free mode of `bossi2009` gives 0.0057 in its clamped mode at 1.243 Hz.
    """
    free = modes(rig, n + _MODES_FOR_CLAMP)
    omega, omega_c = free.frequencies, modes(rig, n, "clamped").frequencies[:, None]
    gap = omega**2 - omega_c**2
    # With a very heavy hub, free and clamped frequency coincide: avoid the division by zero.
    gap[gap == 0] = np.finfo(float).tiny ** 0.5
    delta = free.shape(0.0, 1)[:, 0] / gap
    modal_mass = 1 / (rigid_inertia(rig) * omega_c[:, 0] ** 4) + np.sum(delta**2, axis=1)
    return rig["damping_ratio"] * np.sum(omega * delta**2, axis=1) / (omega_c[:, 0] * modal_mass)


def zero_order_hold_response(
    system: LinearSystem, time: np.ndarray, inputs: ArrayLike, start: ArrayLike | None = None
) -> np.ndarray:
    """Returns the outputs at each instant under inputs held from sample to sample (zero-order hold), exactly.

    x_(k+1) = exp(A dt) x_k + int_0^dt exp(A s) ds B u_k, both from the exponential of [[A, B], [0, 0]] dt
    (C. F. Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans. AC 23, 1978).

    Args:
      system: A, B, C, D.
      time: (m) increasing instants [s], uniform or not.
      inputs: (m) for one input, (m x inputs) for several; the last sample acts only through D.
      start: state at the first instant; 0 by default.

    Returns:
      (m x outputs).

    Raises:
      ValueError: shapes do not match.
    """
    time = np.asarray(time, dtype=float)
    A, B = np.asarray(system.A), np.asarray(system.B)
    u = np.asarray(inputs, dtype=float).reshape(len(time), -1)
    if u.shape[1] != B.shape[1]:
        raise ValueError(f"inputs have shape {np.shape(inputs)}; expected ({len(time)}, {B.shape[1]})")
    states = np.zeros((len(time), len(A)))
    states[0] = 0.0 if start is None else start
    # Steps that are equal but for rounding share one matrix exponential.
    steps = [float(f"{step:.12g}") for step in np.diff(time)]
    held = {step: _zero_order_hold(A, B, step) for step in set(steps)}
    for k, step in enumerate(steps):
        phi, gamma = held[step]
        states[k + 1] = phi @ states[k] + gamma @ u[k]
    return states @ np.asarray(system.C).T + u @ np.asarray(system.D).T


def _zero_order_hold(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns exp(A step) and int_0^step exp(A s) ds B."""
    size = len(A)
    augmented = np.zeros((size + B.shape[1],) * 2)
    augmented[:size, :size], augmented[:size, size:] = A, B
    exponential = expm(augmented * step)
    return exponential[:size, :size], exponential[:size, size:]


def _strain_rows(flexible: Modes, gauges: Sequence[Sensor]) -> dict[str, np.ndarray]:
    """Rows (n) from modal amplitudes to the strain at each gauge: half thickness times curvature."""
    return {g.channel: g.half_thickness * flexible.shape(g.position, 2)[:, 0] for g in gauges}


def _second_order(
    frequencies: np.ndarray,
    damping: ArrayLike,
    force: np.ndarray,
    outputs: Mapping[str, np.ndarray],
    coordinates: list[str],
    name_of_input: str,
) -> control.StateSpace:
    """q_tt + 2 zeta omega q_t + omega^2 q = force u; outputs are linear in q."""
    import control  # the import takes a second: only where it is needed

    n = len(frequencies)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -np.diag(frequencies**2)
    A[n:, n:] = -np.diag(2 * np.asarray(damping) * frequencies)
    B = np.append(np.zeros(n), force)[:, None]
    C = np.array([np.append(row, np.zeros(n)) for row in outputs.values()])
    labels = [*coordinates, *(f"{name}_t" for name in coordinates)]
    return control.ss(A, B, C, 0, states=labels, inputs=[name_of_input], outputs=list(outputs))
