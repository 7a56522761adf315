"""Inertias and Coulomb friction by two torque balances: of the hub alone, and of the whole rig.

The hub, cut off from its link, obeys J0 theta_tt = tau - f - r, with r what the modelled link takes when its root
moves as the hub was measured, in the limit of fine chains: one of 12 segments is off by a thousandth of J0, and by some
percent of f. The whole rig has the angular momentum J theta_t + sum_k K_k w''_t(x_k), the link
moving in as many shapes as there are gauges at x_k; its change is the impulse of tau - f, whatever the link is like.
With f a constant for each direction both are linear in their unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion, label
from scipy.signal import butter, sosfiltfilt

from twin import limit
from twin.driven import DrivenData
from twin.fit import Prepared
from twin.grid_means import mean_torque, one_way, twice_averaged
from twin.identify.results import Estimate
from twin.low_pass import low_passed, smooth
from twin.model import Model, Start
from twin.view import View, move

HUB_BAND, RIG_BAND, RIG_BAND_BELOW = 20.0, 10.0, 6.0
"""Corners of the low-pass on all signals [Hz]: of the hub's balance, of the rig's, and of the one that checks it."""
_REACH = 1.5  # periods of the corner by which a change between rest and motion is kept away
_BLOCK = 0.5  # s, within which errors are taken as one
_LEAST_BLOCKS = 4
_STEADY = 0.95  # share of one direction behind the low-pass from which the friction is that of this direction
_LEAST_RUN = 0.2  # s
_GAUGES = ("strain_base", "strain_mid")


@dataclass(frozen=True)
class Balance:
    """A torque balance by linear regression.

    Attributes:
      inertia: J0 of the hub's balance, J of the rig's [kg m^2].
      coulomb: level of the directions +1 and -1 [N m].
      both: mean of the two levels [N m].
      rate: (n) of the hub [rad/s] where it slides on in one direction; empty of the rig's.
      friction: (n) torque that is left for friction there [N m].
      determination: share of the torque's, or impulse's, variance that the balance explains [1].
    """

    inertia: Estimate
    coulomb: Mapping[int, Estimate]
    both: Estimate
    rate: np.ndarray
    friction: np.ndarray
    determination: float


@dataclass(frozen=True)
class _Rows:
    """Rows of a regression: columns (n x p), the last two of friction; right side (n), rate (n), block index (n)."""

    columns: np.ndarray
    right: np.ndarray
    rate: np.ndarray
    block: np.ndarray


def of_hub(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    """The hub's balance over all recordings with a free hub; None where they say too little.

    Args:
      data: recordings, and where in them the hub slides.
      model: its link, sensors and torque limit count; its hub does not.
      starts: states at the first samples.
    """
    return _balance(data, model, starts, _torques, HUB_BAND)


def with_loss(found: Balance, lossier: Balance | None) -> Balance:
    """The hub's balance, its errors grown by what the uncertainty of the link's damping changes.

    Losses of the link that the model has not look like friction of the hub.

    Args:
      found: the balance.
      lossier: the same with the damping ratio one standard error larger.
    """
    if lossier is None:
        return found

    def grown(a: Estimate, b: Estimate) -> Estimate:
        return Estimate(a.value, math.hypot(a.standard_error, a.value - b.value))

    return replace(
        found,
        inertia=grown(found.inertia, lossier.inertia),
        coulomb={d: grown(level, lossier.coulomb[d]) for d, level in found.coulomb.items()},
        both=grown(found.both, lossier.both),
    )


def of_rig(data: DrivenData, model: Model, starts: Sequence[Start]) -> Balance | None:
    """The whole rig's balance: as `of_hub`, but of the model only sensors and torque limit count.

    A link that moves in more shapes than there are gauges makes the inertia depend on the band: what it changes from
    one to another counts as error.
    """
    found, below = (_balance(data, model, starts, _momenta, band) for band in (RIG_BAND, RIG_BAND_BELOW))
    if found is None or below is None:
        return None
    apart = found.inertia.value - below.inertia.value
    error = math.hypot(found.inertia.standard_error, apart)
    return replace(found, inertia=Estimate(found.inertia.value, error))


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
    errors = (
        *(e.standard_error / area for e in (whole, hub, tip)),
        slope * length.standard_error,
        length.value / 3 * density.standard_error,
    )
    return Estimate(carried - density.value * length.value / 3, math.hypot(*errors))


def _balance(
    data: DrivenData,
    model: Model,
    starts: Sequence[Start],
    rows_of: Callable[[Prepared, View, Model, Start, float], _Rows | None],
    band: float,
) -> Balance | None:
    items = zip(data.prepared, data.views, starts, strict=True)
    parts = [rows_of(p, v, model, s, band) for p, v, s in items if _usable(p, v, model, band)]
    found = [rows for rows in parts if rows is not None]
    if not found or len({rows.columns.shape[1] for rows in found}) > 1:
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
    x, covariance = _clustered(X / size, y, block)
    x, covariance = x / size, covariance / np.outer(size, size)
    errors = np.sqrt(np.diag(covariance))
    estimates = [Estimate(float(v), float(e)) for v, e in zip(x, errors, strict=True)]
    left = y - X @ x
    rate = np.concatenate([rows.rate for rows in found])
    # Behind the low-pass the friction of a hub that swings fast would look like one that grows with the rate.
    steady = (np.abs(X[:, -2:]).max(axis=1) > _STEADY) & (rows_of is _torques)
    both = Estimate(float(x[-2:].mean()), float(np.sqrt(covariance[-2:, -2:].sum())) / 2)
    return Balance(
        estimates[0],
        {1: estimates[-2], -1: estimates[-1]},
        both,
        rate[steady],
        (left + X[:, -2:] @ x[-2:])[steady],
        1 - float(left @ left) / float(y @ y),
    )


def _clustered(X: np.ndarray, y: np.ndarray, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares (p) and its covariance, residuals of a block taken as one piece of evidence (P. J. Huber, 1967).

    There are more blocks than p unknowns, which take as many of them.
    """
    inverse = np.linalg.inv(X.T @ X)
    x = inverse @ X.T @ y
    pulls = np.zeros((int(block.max()) + 1, X.shape[1]))
    np.add.at(pulls, block, X * (y - X @ x)[:, None])
    blocks = len(np.unique(block))
    return x, inverse @ (pulls.T @ pulls) @ inverse * blocks / (blocks - X.shape[1])


def _usable(prepared: Prepared, view: View, model: Model, band: float) -> bool:
    gauges = any(g in prepared.recording and g in model.sensors for g in _GAUGES)
    return prepared.hub is not None and gauges and view.time[-1] - view.time[0] > 10 / band


def _torques(prepared: Prepared, view: View, model: Model, start: Start, band: float) -> _Rows | None:
    t, low = view.time, _low_pass(view.time, band)
    required = _required(prepared, view, model, start)
    link = twice_averaged(required - model.declared["hub_inertia"] * view.acceleration)
    # Friction behind the low-pass that the measured motion has passed.
    forward, backward = (low_passed(s, float(t[1] - t[0]), view.band) for s in _shares(view))
    columns = np.column_stack([low(v) for v in (twice_averaged(view.acceleration), forward, -backward)])
    kept = binary_erosion(view.sliding, iterations=int(_REACH / band / (t[1] - t[0])))
    if not kept.any():
        return None
    # The measured motion has passed one low-pass more than the torque.
    torque = low_passed(mean_torque(model, prepared.recording, t), float(t[1] - t[0]), view.band)
    right = low(torque - link)
    return _Rows(columns[kept], right[kept], view.rate[kept], ((t - t[0]) / _BLOCK).astype(int)[kept])


def _shares(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Shares (m) of a grid step about each instant in which the hub moves forwards and backwards [1]."""
    mean = view.direction * one_way(view.rate, view.acceleration, float(view.time[1] - view.time[0]))
    moves = np.abs(view.direction)
    return (moves + mean) / 2, (moves - mean) / 2


def _required(prepared: Prepared, view: View, model: Model, start: Start) -> np.ndarray:
    """Torque (m) on the hub that its measured motion takes in the limit of fine chains [N m]."""
    chains = [limit.even(model, n) for n in limit.QUICK]
    return limit.weights(limit.QUICK) @ np.array([move(view, prepared, m, start)[1] for m in chains])


def _momenta(prepared: Prepared, view: View, model: Model, start: Start, band: float) -> _Rows | None:
    t, low = view.time, _low_pass(view.time, band)
    hub = smooth(t, low(view.reading))
    bends = [smooth(t, low(b))(t, 1) for b in _curvatures(prepared, view, model)]
    period = float(t[1] - t[0])
    friction = [d * period * np.cumsum(share) for d, share in zip((1, -1), _shares(view), strict=True)]
    impulse = period * np.cumsum(mean_torque(model, prepared.recording, t))
    whole = np.column_stack([hub(t, 1), *bends, *friction, impulse])
    runs, count = label(view.sliding)
    parts: list[np.ndarray] = []
    blocks: list[np.ndarray] = []
    for k in range(1, count + 1):
        inside = runs == k
        if inside.sum() * period > _LEAST_RUN:
            # What was there before the run is not known: a constant for each.
            parts.append(whole[inside] - whole[inside].mean(axis=0))
            blocks.append(np.full(int(inside.sum()), len(blocks)))
    if not parts:
        return None
    rows = np.vstack(parts)
    return _Rows(rows[:, :-1], rows[:, -1], rows[:, 0], np.concatenate(blocks))


def _low_pass(time: np.ndarray, band: float) -> Callable[[np.ndarray], np.ndarray]:
    """A zero-phase low-pass for signals on a uniform clock."""
    period = float(time[1] - time[0])
    sections = butter(4, min(band, 0.4 / period), fs=1 / period, output="sos")
    pad = min(len(time) - 1, int(2 / band / period))
    return lambda values: sosfiltfilt(sections, values, padlen=pad)


def _curvatures(prepared: Prepared, view: View, model: Model) -> list[np.ndarray]:
    """Curvature (m) [1/m] on the grid at each gauge."""
    recording, sensors, found = prepared.recording, model.sensors, []
    for name in _GAUGES:
        if name in recording and name in sensors:
            known = np.isfinite(recording[name])
            strain = np.interp(view.time, recording.time[known], recording[name][known])
            found.append(strain / sensors[name].half_thickness)
    return found
