"""Hub inertia and Coulomb friction by the torque balance of the hub, and the payload that follows from the inertias.

The hub, cut free from its link, obeys J0 theta_tt = tau - f - r. r is the reaction of the modelled link when its root
moves as the hub was measured, in the limit of fine chains: with 12 segments J0 is off by a thousandth, f by some
percent. With a constant f for each direction the balance is linear in its unknowns. Torques of declared effects are
part of tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.signal import butter, sosfiltfilt

from twin.estimation import chain_limit
from twin.identification.estimates import (
    MIN_DETERMINATION,
    TWO_SIDED_95,
    Estimate,
    student_t_estimate,
    with_nuisance_error,
)
from twin.mechanics import planar
from twin.mechanics.state import Start
from twin.residuals.cell_means import double_mean, double_mean_torque, mean_direction
from twin.residuals.data import DrivenData
from twin.residuals.filters import low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import HubTrajectory, View, hub_trajectory, move_link
from twin.rigs.model import Model

HUB_BAND = 20.0
"""Corner of the zero-phase low-pass on all signals of the balance [Hz]."""
_MARGIN = 1.5
"""Margin to a change between rest and motion, in periods of the corner: the reach of the filter."""
_BLOCK = 0.5  # s within which residuals count as correlated
_MIN_BLOCKS = 4  # blocks that a sandwich covariance of the three unknowns needs
_MIN_DIRECTION_SHARE = 0.95
"""Filtered share of one direction above which the friction is that of this direction [1]."""
_GAUGES = ("strain_base", "strain_mid")


@dataclass(frozen=True)
class Balance:
    """Torque balance of the hub by linear regression.

    Attributes:
      inertia: J0 [kg m^2].
      coulomb: Coulomb level of the directions +1 and -1 [N m].
      coulomb_mean: mean of the two levels [N m].
      rate: (n) hub rate where the hub keeps sliding in one direction [rad/s].
      friction: (n) friction torque there: what the rest of the balance leaves [N m].
      determination: R^2 of the balance, about zero [1].
    """

    inertia: Estimate
    coulomb: Mapping[int, Estimate]
    coulomb_mean: Estimate
    rate: np.ndarray
    friction: np.ndarray
    determination: float

    @property
    def accepted(self) -> bool:
        """Whether R^2 is high enough to use the parameters."""
        return self.determination >= MIN_DETERMINATION


@dataclass(frozen=True)
class _RegressionRows:
    """Rows of the regression.

    Attributes:
      columns: (n x p) regressors, the last two of friction.
      right: (n) right side [N m].
      rate: (n) hub rate [rad/s].
      block: (n) index of the block of correlated residuals.
    """

    columns: np.ndarray
    right: np.ndarray
    rate: np.ndarray
    block: np.ndarray


def hub_balance(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    """Returns the torque balance over all recordings with a free hub.

    None where the recordings do not determine it, or where a backlash is declared: the hub is then not what the motor
    turns.

    Args:
      data: recordings, and where in them the hub slides.
      model: its link, sensors, effects and torque limit are used; its hub is not.
      starts: states at the first samples.
    """
    return None if model.plant.motor.gap > 0 else _regress(data, model, starts)


def effect_torque(model: Model, time: np.ndarray, hub: HubTrajectory) -> np.ndarray:
    """Torque (m) of the declared effects on the hub along its motion, without friction [N m]."""
    return planar.hub_torque_along(model.plant, time - time[0], hub.angle, hub.rate, np.zeros(len(time)))


def with_balance_nuisance_error(balance: Balance, perturbed: Balance) -> Balance:
    """Returns the balance, its errors increased by that of a nuisance parameter.

    Link losses that the model lacks look like hub friction, and so does a declared effect that brakes the hub.

    Args:
      balance: with the nuisance parameter at its estimate.
      perturbed: with the nuisance parameter one standard error larger.
    """
    return replace(
        balance,
        inertia=with_nuisance_error(balance.inertia, perturbed.inertia),
        coulomb={d: with_nuisance_error(level, perturbed.coulomb[d]) for d, level in balance.coulomb.items()},
        coulomb_mean=with_nuisance_error(balance.coulomb_mean, perturbed.coulomb_mean),
    )


def tip_mass_from_inertias(total: Estimate, hub: Estimate, link: Mapping[str, Estimate]) -> Estimate:
    """Returns the tip mass m_p = (J - J0 - J_p)/l^2 - rho l/3 [kg].

    Args:
      total, hub: J and J0 [kg m^2].
      link: `length` l, `linear_density` rho and `tip_inertia` J_p.
    """
    length, density, tip = (link[name] for name in ("length", "linear_density", "tip_inertia"))
    area = length.value**2
    carried = (total.value - hub.value - tip.value) / area
    # Derivative of m_p by l, without its sign.
    slope = 2 * carried / length.value + density.value / 3
    others = math.hypot(
        *(e.standard_error / area for e in (hub, tip)),
        slope * length.standard_error,
        length.value / 3 * density.standard_error,
    )
    value = carried - density.value * length.value / 3
    low, high = total.interval
    half = math.hypot((high - low) / 2 / area, TWO_SIDED_95 * others)
    error = math.hypot(total.standard_error / area, others)
    return Estimate(value, error, (value - half, value + half))


def _regress(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    items = zip(data.prepared, data.views, starts, strict=True)
    parts = [_regression_rows(p, v, model, s) for p, v, s in items if _usable(p, v, model)]
    rows = _joined([part for part in parts if part is not None])
    if rows is None:
        return None
    X, y = rows.columns, rows.right
    size = np.sqrt((X**2).mean(axis=0))
    if (
        len(np.unique(rows.block)) < max(_MIN_BLOCKS, X.shape[1] + 1)
        or not size.all()
        or np.linalg.cond(X / size) > 1e4
    ):
        return None
    x, covariance = clustered_least_squares(X / size, y, rows.block)
    x, covariance = x / size, covariance / np.outer(size, size)
    errors = np.sqrt(np.diag(covariance))
    free = len(np.unique(rows.block)) - X.shape[1]
    estimates = [student_t_estimate(float(v), float(e), free) for v, e in zip(x, errors, strict=True)]
    residual = y - X @ x
    # Near reversals the filtered friction of a fast oscillation would look like one that grows with the rate.
    steady = np.abs(X[:, -2:]).max(axis=1) > _MIN_DIRECTION_SHARE
    mean = student_t_estimate(float(x[-2:].mean()), float(np.sqrt(covariance[-2:, -2:].sum())) / 2, free)
    return Balance(
        estimates[0],
        {1: estimates[-2], -1: estimates[-1]},
        mean,
        rows.rate[steady],
        (residual + X[:, -2:] @ x[-2:])[steady],
        1 - float(residual @ residual) / float(y @ y),
    )


def _joined(parts: Sequence[_RegressionRows]) -> _RegressionRows | None:
    """Rows of all recordings, each with blocks of its own; None without any."""
    if not parts:
        return None
    offsets = np.cumsum([0, *(int(part.block.max()) + 1 for part in parts[:-1])])
    return _RegressionRows(
        np.vstack([part.columns for part in parts]),
        np.concatenate([part.right for part in parts]),
        np.concatenate([part.rate for part in parts]),
        np.concatenate([part.block + k for part, k in zip(parts, offsets, strict=True)]),
    )


def clustered_least_squares(X: np.ndarray, y: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns least squares (p) and its sandwich covariance (p x p) with residuals clustered by block.

    P. J. Huber, 1967; the covariance is corrected for the p degrees of freedom that the fit takes of the blocks.

    Args:
      X: regressors (n x p).
      y: right side (n).
      block: (n) index of each row's block; more than p different ones.
    """
    inverse = np.linalg.inv(X.T @ X)
    x = inverse @ X.T @ y
    scores = np.zeros((int(block.max()) + 1, X.shape[1]))
    np.add.at(scores, block, X * (y - X @ x)[:, None])
    blocks = len(np.unique(block))
    return x, inverse @ (scores.T @ scores) @ inverse * blocks / (blocks - X.shape[1])


def available_gauges(prepared: Prepared, model: Model) -> list[str]:
    """Strain gauges of the recording whose place on the link is declared."""
    return [g for g in _GAUGES if g in prepared.recording and g in model.sensors]


def _usable(prepared: Prepared, view: View, model: Model) -> bool:
    long = view.time[-1] - view.time[0] > 10 / HUB_BAND
    return prepared.hub is not None and bool(available_gauges(prepared, model)) and bool(long)


def _regression_rows(prepared: Prepared, view: View, model: Model, start: Start) -> _RegressionRows | None:
    """Rows of one recording while the hub slides: J0, Coulomb forwards, Coulomb backwards; None where it never does."""
    t, low, hub = view.time, _low_pass(view.time, HUB_BAND), hub_trajectory(view, model)
    required = _required_torque(prepared, view, model, start)
    reaction = double_mean(required - model.declared["hub_inertia"] * hub.acceleration)
    # Friction passes the low-pass that the measured motion has passed.
    forward, backward = (low_passed(s, float(t[1] - t[0]), view.band) for s in direction_shares(view))
    columns = np.column_stack([low(v) for v in (double_mean(hub.acceleration), forward, -backward)])
    kept = binary_erosion(view.sliding, iterations=int(_MARGIN / HUB_BAND / (t[1] - t[0])))
    if not kept.any():
        return None
    # The measured motion has passed one low-pass more than the torque.
    torque = low_passed(double_mean_torque(model.drive(prepared.recording), t), float(t[1] - t[0]), view.band)
    right = low(torque + effect_torque(model, t, hub) - reaction)
    block = ((t - t[0]) / _BLOCK).astype(int)
    return _RegressionRows(columns[kept], right[kept], hub.rate[kept], block[kept])


def direction_shares(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Share (m) of the grid step about each instant in which the hub moves forwards, and backwards [1]."""
    mean = view.direction * mean_direction(view.rate, view.acceleration, float(view.time[1] - view.time[0]))
    moves = np.abs(view.direction)
    return (moves + mean) / 2, (moves - mean) / 2


def _required_torque(prepared: Prepared, view: View, model: Model, start: Start) -> np.ndarray:
    """Torque (m) on the hub that its measured motion requires, in the limit of fine chains [N m]."""
    chains = [chain_limit.with_segments(model, n) for n in chain_limit.PRECISE]
    return chain_limit.richardson_weights(chain_limit.PRECISE) @ np.array(
        [move_link(view, prepared, m, start)[1] for m in chains]
    )


def _low_pass(time: np.ndarray, band: float) -> Callable[[np.ndarray], np.ndarray]:
    """A zero-phase low-pass with corner `band` [Hz] for signals on a uniform clock."""
    period = float(time[1] - time[0])
    sections = butter(4, min(band, 0.4 / period), fs=1 / period, output="sos")
    pad = min(len(time) - 1, int(2 / band / period))
    return lambda values: sosfiltfilt(sections, values, padlen=pad)
