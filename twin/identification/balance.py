"""Inertia and Coulomb friction of the hub by its torque balance, and the payload that the inertias leave.

The hub, cut off from its link, obeys J0 theta_tt = tau - f - r, with r what the modelled link takes when its root
moves as the hub was measured, in the limit of fine chains: one of 12 segments is off by a thousandth of J0, and by some
percent of f. With f a constant for each direction it is linear in its unknowns. What effects that are known to act
put on the hub is part of tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.signal import butter, sosfiltfilt

from twin.estimation import chain_limit
from twin.identification.estimates import EXPLAINED, TWO_SIDED_95, Estimate, grown
from twin.mechanics import planar
from twin.mechanics.state import Start
from twin.residuals.cell_means import double_mean, double_mean_torque, mean_direction
from twin.residuals.data import DrivenData
from twin.residuals.filters import low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import HubTrajectory, View, hub_trajectory, move_link
from twin.rigs.model import Model

HUB_BAND = 20.0
"""Corner of the low-pass on all signals [Hz]."""
_REACH = 1.5  # periods of the corner by which a change between rest and motion is kept away
_BLOCK = 0.5  # s, within which errors are taken as one
_LEAST_BLOCKS = 4
_STEADY = 0.95  # share of one direction behind the low-pass from which the friction is that of this direction
_GAUGES = ("strain_base", "strain_mid")


@dataclass(frozen=True)
class Balance:
    """A torque balance by linear regression.

    Attributes:
      inertia: J0 [kg m^2].
      coulomb: level of the directions +1 and -1 [N m].
      both: mean of the two levels [N m].
      rate: (n) of the hub [rad/s] where it slides on in one direction.
      friction: (n) torque that is left for friction there [N m].
      determination: share of the torque's variance that the balance explains [1].
    """

    inertia: Estimate
    coulomb: Mapping[int, Estimate]
    both: Estimate
    rate: np.ndarray
    friction: np.ndarray
    determination: float

    @property
    def believed(self) -> bool:
        """Whether it explains enough for its numbers to be estimates."""
        return self.determination >= EXPLAINED


@dataclass(frozen=True)
class _Rows:
    """Rows of a regression: columns (n x p), the last two of friction; right side (n), rate (n), block index (n)."""

    columns: np.ndarray
    right: np.ndarray
    rate: np.ndarray
    block: np.ndarray


def of_hub(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    """The hub's balance over all recordings with a free hub; None where they say too little, or a play is known of.

    Args:
      data: recordings, and where in them the hub slides.
      model: its link, sensors and torque limit count; its hub does not.
      starts: states at the first samples.
    """
    return None if model.plant.motor.gap > 0 else _balance(data, model, starts)


def by_laws(model: Model, time: np.ndarray, hub: HubTrajectory) -> np.ndarray:
    """Torque (m) of the known effects on the hub along its motion, friction apart [N m]."""
    return planar.hub_laws(model.plant, time, hub.angle, hub.rate, np.zeros(len(time)))


def with_error_of(found: Balance, other: Balance) -> Balance:
    """The hub's balance, its errors grown by that of something else that it takes as known.

    Losses of the link that the model has not look like friction of the hub, and so does what an effect brakes.

    Args:
      found: the balance.
      other: the same with that one standard error larger.
    """
    return replace(
        found,
        inertia=grown(found.inertia, other.inertia),
        coulomb={d: grown(level, other.coulomb[d]) for d, level in found.coulomb.items()},
        both=grown(found.both, other.both),
    )


def payload(whole: Estimate, hub: Estimate, link: Mapping[str, Estimate]) -> Estimate:
    """The tip mass [kg] that the total inertia leaves, m_p = (J - J0 - J_p)/l^2 - rho l/3.

    Args:
      whole, hub: J and J0 [kg m^2].
      link: `length` l, `linear_density` rho and `tip_inertia` J_p.
    """
    length, density, tip = (link[name] for name in ("length", "linear_density", "tip_inertia"))
    area = length.value**2
    carried = (whole.value - hub.value - tip.value) / area
    slope = 2 * carried / length.value + density.value / 3
    others = math.hypot(
        *(e.standard_error / area for e in (hub, tip)),
        slope * length.standard_error,
        length.value / 3 * density.standard_error,
    )
    value = carried - density.value * length.value / 3
    low, high = whole.interval
    half = math.hypot((high - low) / 2 / area, TWO_SIDED_95 * others)
    error = math.hypot(whole.standard_error / area, others)
    return Estimate(value, error, (value - half, value + half))


def _balance(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    items = zip(data.prepared, data.views, starts, strict=True)
    parts = [_torques(p, v, model, s) for p, v, s in items if _usable(p, v, model)]
    found = [rows for rows in parts if rows is not None]
    if not found:
        return None
    offsets = np.cumsum([0, *(int(rows.block.max()) + 1 for rows in found[:-1])])
    block = np.concatenate([rows.block + k for rows, k in zip(found, offsets, strict=True)])
    X = np.vstack([rows.columns for rows in found])
    y = np.concatenate([rows.right for rows in found])
    size = np.sqrt((X**2).mean(axis=0))
    if (
        len(np.unique(block)) < max(_LEAST_BLOCKS, X.shape[1] + 1)
        or not size.all()
        or np.linalg.cond(X / size) > 1e4
    ):
        return None
    x, covariance = clustered(X / size, y, block)
    x, covariance = x / size, covariance / np.outer(size, size)
    errors = np.sqrt(np.diag(covariance))
    estimates = [Estimate(float(v), float(e)) for v, e in zip(x, errors, strict=True)]
    left = y - X @ x
    rate = np.concatenate([rows.rate for rows in found])
    # Behind the low-pass the friction of a hub that swings fast would look like one that grows with the rate.
    steady = np.abs(X[:, -2:]).max(axis=1) > _STEADY
    both = Estimate(float(x[-2:].mean()), float(np.sqrt(covariance[-2:, -2:].sum())) / 2)
    return Balance(
        estimates[0],
        {1: estimates[-2], -1: estimates[-1]},
        both,
        rate[steady],
        (left + X[:, -2:] @ x[-2:])[steady],
        1 - float(left @ left) / float(y @ y),
    )


def clustered(X: np.ndarray, y: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares (p) and its covariance, residuals of a block taken as one piece of evidence (P. J. Huber, 1967).

    There are more blocks than p unknowns, which take as many of them.

    Args:
      X: columns (n x p).
      y: right side (n).
      block: index of each row's block (n).
    """
    inverse = np.linalg.inv(X.T @ X)
    x = inverse @ X.T @ y
    pulls = np.zeros((int(block.max()) + 1, X.shape[1]))
    np.add.at(pulls, block, X * (y - X @ x)[:, None])
    blocks = len(np.unique(block))
    return x, inverse @ (pulls.T @ pulls) @ inverse * blocks / (blocks - X.shape[1])


def gauges(prepared: Prepared, model: Model) -> list[str]:
    """Strain gauges that the recording has and the model knows of."""
    return [g for g in _GAUGES if g in prepared.recording and g in model.sensors]


def _usable(prepared: Prepared, view: View, model: Model) -> bool:
    long = view.time[-1] - view.time[0] > 10 / HUB_BAND
    return prepared.hub is not None and bool(gauges(prepared, model)) and bool(long)


def _torques(prepared: Prepared, view: View, model: Model, start: Start) -> _Rows | None:
    t, low, hub = view.time, _low_pass(view.time, HUB_BAND), hub_trajectory(view, model)
    required = _required(prepared, view, model, start)
    link = double_mean(required - model.declared["hub_inertia"] * hub.acceleration)
    # Friction behind the low-pass that the measured motion has passed.
    forward, backward = (low_passed(s, float(t[1] - t[0]), view.band) for s in shares(view))
    columns = np.column_stack([low(v) for v in (double_mean(hub.acceleration), forward, -backward)])
    kept = binary_erosion(view.sliding, iterations=int(_REACH / HUB_BAND / (t[1] - t[0])))
    if not kept.any():
        return None
    # The measured motion has passed one low-pass more than the torque.
    torque = low_passed(double_mean_torque(model, prepared.recording, t), float(t[1] - t[0]), view.band)
    right = low(torque + by_laws(model, t, hub) - link)
    return _Rows(columns[kept], right[kept], hub.rate[kept], ((t - t[0]) / _BLOCK).astype(int)[kept])


def shares(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Shares (m) of a grid step about each instant in which the hub moves forwards and backwards [1]."""
    mean = view.direction * mean_direction(view.rate, view.acceleration, float(view.time[1] - view.time[0]))
    moves = np.abs(view.direction)
    return (moves + mean) / 2, (moves - mean) / 2


def _required(prepared: Prepared, view: View, model: Model, start: Start) -> np.ndarray:
    """Torque (m) on the hub that its measured motion takes in the limit of fine chains [N m]."""
    chains = [chain_limit.with_equal_segments(model, n) for n in chain_limit.STANDARD]
    return chain_limit.richardson_weights(chain_limit.STANDARD) @ np.array(
        [move_link(view, prepared, m, start)[1] for m in chains]
    )


def _low_pass(time: np.ndarray, band: float) -> Callable[[np.ndarray], np.ndarray]:
    """A zero-phase low-pass for signals on a uniform clock."""
    period = float(time[1] - time[0])
    sections = butter(4, min(band, 0.4 / period), fs=1 / period, output="sos")
    pad = min(len(time) - 1, int(2 / band / period))
    return lambda values: sosfiltfilt(sections, values, padlen=pad)
