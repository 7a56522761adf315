"""The variable on which the residuals of a model depend: the share of their variance that it explains.

A function of one variable, or of two, is fitted to the residuals as a step function. Its share of the variance is
cross-validated: the steps that predict one recording are means over the others. The variables are hub angle and rate,
commanded torque, time since the recording began, tip rate and the strains. A parameter that drifts during a recording,
and rare impacts count as dependence on time. The travel of the hub since its last reversal is the variable of
hysteresis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from twin.diagnosis.rules import MODEL_SHARE
from twin.estimation import output_error
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import CORRELATION_TIME, Workbench
from twin.recording import HUB_TORQUE
from twin.residuals import residual
from twin.residuals.data import BLOCK_SPAN, DrivenData
from twin.residuals.filters import GRID, STRIDE
from twin.residuals.numerics import ROUNDING
from twin.residuals.residual import EVENT_CHANNELS
from twin.residuals.view import as_read, move_link
from twin.rigs.model import with_fine_chain

_BINS = (16, 100)
"""Numbers of bins of a step function, each bin with as many samples. Only narrow bins resolve a dead zone."""
_COARSE = 8
"""Bins of each variable of a step function of two, and of the time in which a parameter drifts."""
_PAIR_FACTOR = 1.5
"""A pair has to explain this many times the share of the best single variable, and `MODEL_SHARE` more."""
_RARE = 0.2  # largest share of a recording that has impacts
TRAVEL = "hub_travel"
"""Travel of the hub since its last reversal [rad], the variable of hysteresis."""


@dataclass(frozen=True)
class Unexplained:
    """Residuals of one channel in all fit recordings, concatenated.

    Attributes:
      values: (n) in the channel's unit.
      variables: name -> (n) on which they may depend, SI.
      recording: (n) index of the recording.
      time: (n) [s], concatenated, too.
      white: (n) the whitened residuals, in noise units.
      slopes: parameter -> (n) derivative of `white`; of the torque balance of the hub alone.
    """

    values: np.ndarray
    variables: dict[str, np.ndarray]
    recording: np.ndarray
    time: np.ndarray
    white: np.ndarray
    slopes: Mapping[str, np.ndarray] = field(default_factory=dict)


# Residuals with their variables


def unexplained_residuals(bench: Workbench, fit: Fit) -> dict[str, Unexplained]:
    """Channel -> its residuals on driven data under a fit, on a fine chain without much discretisation error."""
    data = output_error.driven_data(bench)
    bench, fit = output_error.on_driven_data(bench, fit)
    fit = replace(fit, model=with_fine_chain(fit.model))
    recordings = list(bench.pool.map(lambda i: _in_recording(bench, data, fit, i), range(len(data.prepared))))
    channels = dict.fromkeys(channel for parts in recordings for channel in parts)
    return {c: _joined([parts[c] for parts in recordings if c in parts]) for c in channels}


def _joined(parts: Sequence[Unexplained]) -> Unexplained:
    """The residuals of one channel of all recordings."""
    shared = set.intersection(*(set(part.variables) for part in parts))
    return Unexplained(
        np.concatenate([part.values for part in parts]),
        {name: np.concatenate([part.variables[name] for part in parts]) for name in sorted(shared)},
        np.concatenate([part.recording for part in parts]),
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.white for part in parts]),
        {name: np.concatenate([part.slopes[name] for part in parts]) for name in parts[0].slopes},
    )


def _in_recording(bench: Workbench, data: DrivenData, fit: Fit, i: int) -> dict[str, Unexplained]:
    """Channel -> its residuals in recording i."""
    view = data.views[i]
    values = residual.raw_residual(view, data.prepared[i], fit.model, fit.starts[i])
    white = residual.normalise_all(values, view)
    variables = _with_strains(data, fit, i, values)
    before = sum(v.time[-1] - v.time[0] for v in data.views[:i])
    # A link that diverges on driven data, under a fit to other data, has no residuals.
    followed = np.all(np.isfinite(list(variables.values())), axis=0)
    channels = {}
    for group in data.groups:
        if group.recording != i or group.channel in EVENT_CHANNELS:
            continue
        at = group.instants
        keep = (bench.weight[group.rows] > 0) & followed[at]
        late = fit.model.hub_late if group.channel == HUB_TORQUE else 0.0
        channels[group.channel] = Unexplained(
            values[group.channel][at[keep]],
            {name: as_read(view.time, late, variable)[at[keep]] for name, variable in variables.items()},
            np.full(keep.sum(), i),
            before + view.time[at[keep]] - view.time[0],
            white[group.channel][keep],
            slopes=_slopes(fit, np.flatnonzero(keep) + group.rows.start)
            if group.channel == HUB_TORQUE
            else {},
        )
    return channels


def motion_variables(data: DrivenData, fit: Fit, i: int) -> dict[str, np.ndarray]:
    """Name -> (m) command, time, and motion of the model in recording i, SI, on the grid of its view."""
    view, prepared = data.views[i], data.prepared[i]
    motion, _ = move_link(view, prepared, fit.model, fit.starts[i])
    command = fit.model.drive(prepared.recording).at(view.time)
    return {
        "hub_angle": motion.angles[:, 0],
        "hub_rate": motion.rates[:, 0],
        "torque_command": command,
        "time": view.time - view.time[0],
        "tip_rate": np.sum(
            np.cos(motion.angles - motion.angles[:, :1]) * motion.rates * fit.model.chain.lengths, 1
        ),
    }


def variables_in(data: DrivenData, fit: Fit, i: int) -> dict[str, np.ndarray]:
    """Name -> (m) all variables in recording i, SI, on the grid of its view."""
    values = residual.raw_residual(data.views[i], data.prepared[i], fit.model, fit.starts[i])
    return _with_strains(data, fit, i, values)


def _with_strains(
    data: DrivenData, fit: Fit, i: int, values: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """The variables of recording i, given its raw residuals: those of the motion, and strains as simulated.

    Simulated is measured minus residual: a faulty reading would depend on itself.
    """
    measured = data.views[i].measured.items()
    strains = {c: v - values[c] for c, v in measured if c.startswith("strain")}
    return motion_variables(data, fit, i) | strains


def _slopes(fit: Fit, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Parameter of the rig or of its effects -> derivative (n) of these rows of the residual."""
    return {u.full_name: fit.jacobian[rows, j] for j, u in enumerate(fit.unknowns) if u.is_parameter}


# Shares of the variance


def strongest_variables(channels: Sequence[Unexplained]) -> tuple[str, ...]:
    """Variables that explain at least `MODEL_SHARE` of the variance of a channel, the largest share first.

    If there is none and the residuals of a channel are rare impacts, it is time.
    """
    best: dict[str, float] = {}
    for unexplained in channels:
        for name, share in variance_shares(unexplained):
            best[name] = max(best.get(name, 0.0), share)
    ranked = tuple(name for name, share in sorted(best.items(), key=lambda p: -p[1]) if share > MODEL_SHARE)
    return ranked or (("time",) if any(map(_has_rare_impacts, channels)) else ())


def variance_shares(unexplained: Unexplained) -> list[tuple[str, float]]:
    """Variable and the share of the variance (0 to 1) that it explains, largest first.

    By a step function of each variable, cross-validated between recordings. Both variables of a pair get the share of
    the pair if it is much larger than that of either, as of friction that decreases with time. If no variable explains
    anything, as when a fault shows in one recording only, the cross-validation is between stretches of all recordings,
    and the travel of the hub is one more variable. Time also gets the share of a drifting parameter if it is larger.
    """
    if not np.any(unexplained.values) or not unexplained.variables:
        return []
    shares = step_shares(unexplained)
    pair, of_pair = _best_pair(unexplained)
    if of_pair > MODEL_SHARE + _PAIR_FACTOR * max(shares.values()):
        alone = _within_recordings(unexplained, shares)
        # The variable with the larger share by itself comes first.
        shares |= {name: of_pair + 1e-3 * alone[name] for name in pair}
    if max(shares.values()) < MODEL_SHARE:
        shares = _within_recordings(unexplained, shares)
    if "time" in shares:
        shares["time"] = max(shares["time"], parameter_drift(unexplained)[1])
    return sorted(shares.items(), key=lambda pair: -pair[1])


def step_shares(unexplained: Unexplained) -> dict[str, float]:
    """Variable -> share of the variance by a step function, cross-validated between recordings."""
    return _shares(unexplained, unexplained.recording)


def _within_recordings(unexplained: Unexplained, shares: Mapping[str, float]) -> dict[str, float]:
    """The shares, and that of the travel; those cross-validated between stretches where above `MODEL_SHARE`."""
    with_travel = {name: unexplained.variables[name] for name in shares} | travel(unexplained)
    shares = dict.fromkeys(with_travel, 0.0) | dict(shares)
    unexplained = replace(unexplained, variables=with_travel)
    by_stretch = _shares(unexplained, np.floor(unexplained.time / (BLOCK_SPAN / 2)).astype(int))
    return {name: by_stretch[name] if by_stretch[name] > MODEL_SHARE else s for name, s in shares.items()}


def travel(unexplained: Unexplained) -> dict[str, np.ndarray]:
    """`TRAVEL` -> (n) angle of the hub since its last reversal, or since a gap [rad]; empty if the hub is clamped."""
    if not {"hub_angle", "hub_rate"} <= unexplained.variables.keys():
        return {}
    angle, rate = unexplained.variables["hub_angle"], unexplained.variables["hub_rate"]
    reversal = np.diff(np.sign(rate)) != 0
    gap = (np.diff(unexplained.time) > 2 * STRIDE * GRID) | (np.diff(unexplained.recording) != 0)
    begins = np.append(True, reversal | gap)
    first = np.maximum.accumulate(np.where(begins, np.arange(len(angle)), 0))
    return {TRAVEL: angle - angle[first]}


def _shares(unexplained: Unexplained, part: np.ndarray) -> dict[str, float]:
    return {name: _cross_share(unexplained.values, v, part) for name, v in unexplained.variables.items()}


def _best_pair(unexplained: Unexplained) -> tuple[tuple[str, ...], float]:
    """The two variables whose common step function explains most of the variance, and this share."""
    _, part = np.unique(unexplained.recording, return_inverse=True)
    cells = {name: np.searchsorted(_edges(v, _COARSE), v) for name, v in unexplained.variables.items()}
    shares = {
        (a, b): _share_in_cells(unexplained.values, cells[a] * _COARSE + cells[b], part, _COARSE**2)
        for a, b in combinations(sorted(cells, key=lambda name: name != "time"), 2)
    }
    return max(shares.items(), key=lambda item: item[1], default=((), 0.0))


def _cross_share(values: np.ndarray, variable: np.ndarray, part: np.ndarray) -> float:
    """Share of the variance of values (n) by a step function of a variable (n), cross-validated between parts (n).

    It is the larger one of those with wide and with narrow bins.
    """
    _, part = np.unique(part, return_inverse=True)
    return max(
        _share_in_cells(values, np.searchsorted(_edges(variable, count), variable), part, count)
        for count in _BINS
    )


def _edges(variable: np.ndarray, count: int) -> np.ndarray:
    """Inner edges (count - 1) of bins with equal numbers of samples."""
    return np.quantile(variable, np.linspace(0, 1, count + 1)[1:-1])


def _share_in_cells(
    values: np.ndarray, cell: np.ndarray, part: np.ndarray, count: int, slope: np.ndarray | None = None
) -> float:
    """Cross-validated share of the variance by a step function: 1 minus the predicted sum of squares over the total.

    Args:
      values: (n).
      cell: (n) index of the step.
      part: (n) index of the part; the steps that predict it come from the other parts.
      count: number of steps.
      slope: (n) by which the step function is multiplied; 1 by default.
    """
    slope = np.ones(len(values)) if slope is None else slope
    here = part * count + cell
    size = (part.max() + 1) * count
    sums, squares = (np.bincount(here, w, size).reshape(-1, count) for w in (values * slope, slope**2))
    others = squares.sum(0) - squares
    determined = others > ROUNDING * squares.sum()
    means = np.where(determined, (sums.sum(0) - sums) / np.where(determined, others, 1.0), 0.0)
    remaining = np.sum((values - means.ravel()[here] * slope) ** 2)
    return max(0.0, 1 - float(remaining / np.sum(values**2)))


# Special cases of a dependence on time


def parameter_drift(unexplained: Unexplained) -> tuple[str, float]:
    """The parameter whose drift within each recording explains most of the variance, and this share; ("", 0) if none.

    The drift is a step function of the time since the recording began, the same in each, times the derivative of the
    residual by the parameter. A step function of time alone does not show it: the derivative oscillates with the link.
    """
    _, part = np.unique(unexplained.recording, return_inverse=True)
    time = unexplained.variables["time"]
    cell = np.searchsorted(_edges(time, _COARSE), time)
    shares = {
        name: _share_in_cells(unexplained.white, cell, part, _COARSE, slope)
        for name, slope in unexplained.slopes.items()
        if np.any(slope)
    }
    return max(shares.items(), key=lambda pair: pair[1], default=("", 0.0))


def _has_rare_impacts(unexplained: Unexplained) -> bool:
    """Whether most of the variance is in a few short pieces of time, and all other pieces are noise.

    It is conclusive only if no variable explains a channel: a hub that hits a stop causes such residuals of strains.
    """
    _, piece = np.unique(np.floor(unexplained.time / CORRELATION_TIME), return_inverse=True)
    count, power = np.bincount(piece), np.bincount(piece, unexplained.white**2)
    quietest = np.argsort(power / count)
    size = np.sqrt(np.cumsum(power[quietest]) / np.cumsum(count[quietest]))
    quiet = quietest[size <= ADEQUATE_RMS]
    return bool(2 * power[quiet].sum() < power.sum() and len(quiet) > (1 - _RARE) * len(count))
