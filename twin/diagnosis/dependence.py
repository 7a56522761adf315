"""What a model leaves unexplained, local in time, and the variable that it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.fft import next_fast_len, rfft, rfftfreq

from twin.diagnosis import regressors
from twin.estimation.fit import Fit
from twin.estimation.loss import ADEQUATE_RMS
from twin.estimation.workbench import Workbench
from twin.recording import HUB
from twin.residuals import residual
from twin.residuals.data import EVENT_CHANNELS, DrivenData
from twin.residuals.filters import BAND, GRID
from twin.rigs.model import fine

_BINS = (16, 100)  # of a variable, each with as many samples
_COARSE = 8  # bins of each of two variables
_TOGETHER = 1.5  # times the share of the best alone that two have to explain together
_FEWEST = 20  # samples that tell the mean of a bin
_FEWEST_SHOWN = 50  # samples of a trace that is worth a picture
_STRETCH = 0.75  # s
_UNSEEN = 0.01  # s without a residual, after which nothing tells where the hub turned round
_SLOWEST = 0.3  # Hz, of an oscillation that is looked for
_BESIDE = 0.15  # of the frequency of a mode, by which it is another one
_LOBE = 1.5  # times one over the time that was recorded, by which two frequencies are told apart
_ABOUT, _SHARP = 1.0, 20.0  # Hz about an oscillation, and times as strong as most there that it has to be
_LOUD = 4.0  # times its usual size at most a residual counts: one event must not pass for an oscillation
_KNOCK = 0.05  # s, pieces of time in which knocks are looked for
_SELDOM = 0.2  # share of the pieces that knocks may fall into
DEPENDS = 0.05  # share of the variance from which a residual depends on a variable
TRAVEL = "hub_travel"
"""How far the hub has turned since it turned round [rad]: what it did before."""


@dataclass(frozen=True)
class Unexplained:
    """Residuals of one channel over all fit recordings, one after the other.

    Attributes:
      values: (n) in the channel's unit.
      variables: name -> (n) what they may depend on.
      recording: (n) index of the recording.
      time: (n) [s], the recordings one after the other.
      white: (n) the same residuals in noise units, noise as large at every frequency.
      rings: at which hub and link swing whatever is missing, the hub held or free [Hz].
      slopes: parameter -> (n) what it changes in `white`; of the torque on the hub alone, which has no memory.
    """

    values: np.ndarray
    variables: dict[str, np.ndarray]
    recording: np.ndarray
    time: np.ndarray
    white: np.ndarray
    rings: tuple[float, ...] = ()
    slopes: Mapping[str, np.ndarray] = field(default_factory=dict)


def unexplained_residuals(bench: Workbench, data: DrivenData, fit: Fit) -> dict[str, Unexplained]:
    """Channel -> its residuals under a fit, with the variables on which they may depend.

    On a fine chain: what a short one gets wrong is nothing that is missing.
    """
    fit = replace(fit, model=fine(fit.model))
    recordings = [_in_recording(bench, data, fit, i) for i in range(len(data.prepared))]
    channels = dict.fromkeys(channel for parts in recordings for channel in parts)
    modes = np.concatenate([fit.model.chain.modes(boundary)[0] for boundary in ("clamped", "free")])
    rings = tuple(modes[modes > 0] / (2 * np.pi))
    return {c: _joined([parts[c] for parts in recordings if c in parts], rings) for c in channels}


def _joined(parts: Sequence[Unexplained], rings: tuple[float, ...]) -> Unexplained:
    """The residuals of one channel, recording after recording."""
    shared = set.intersection(*(set(part.variables) for part in parts))
    return Unexplained(
        np.concatenate([part.values for part in parts]),
        {name: np.concatenate([part.variables[name] for part in parts]) for name in sorted(shared)},
        np.concatenate([part.recording for part in parts]),
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.white for part in parts]),
        rings,
        {name: np.concatenate([part.slopes[name] for part in parts]) for name in parts[0].slopes},
    )


def _in_recording(bench: Workbench, data: DrivenData, fit: Fit, i: int) -> dict[str, Unexplained]:
    view = data.views[i]
    left = residual.raw_residual(view, data.prepared[i], fit.model, fit.starts[i])
    white = residual.normalise_all(left, view)
    seen = regressors.of_motion(data, fit, i) | regressors.of_strains(view, left)
    before = sum(v.time[-1] - v.time[0] for v in data.views[:i])
    found = {}
    for group in data.groups:
        if group.recording != i or group.channel in EVENT_CHANNELS:
            continue
        keep = bench.weight[group.rows] > 0
        found[group.channel] = Unexplained(
            left[group.channel][keep],
            {name: variable[keep] for name, variable in seen.items()},
            np.full(keep.sum(), i),
            before + view.time[keep] - view.time[0],
            white[group.channel][keep],
            slopes=_slopes(fit, np.flatnonzero(keep) + group.rows.start) if group.channel == HUB else {},
        )
    return found


def _slopes(fit: Fit, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Parameter -> what it changes in these residuals (n)."""
    return {u.full_name: fit.jacobian[rows, j] for j, u in enumerate(fit.unknowns) if u.is_parameter}


def variance_shares(found: Unexplained) -> list[tuple[str, float]]:
    """Share of the variance (0 to 1) that a step function of each variable explains, best first.

    A variable that explains the residual does so in every recording: the bins' means come from the other ones. Two
    that explain much more together than either alone, as a friction that wanes does by rate and time, share that, the
    one first that tells more by itself.
    Where none does, as when a fault shows in one experiment alone, the means come from the other stretches of all
    recordings, and how far the hub has turned since it turned round is asked, too, on which hysteresis depends. What
    swings at one frequency depends on time, and so does what a parameter does that changes as a recording goes on.
    """
    if not np.any(found.values) or not found.variables:
        return []
    shares = step_shares(found)
    pair, together = _best_pair(found)
    if together > DEPENDS + _TOGETHER * max(shares.values()):
        alone = _seldom(found, shares)
        shares |= {name: together + 1e-3 * alone[name] for name in pair}
    if max(shares.values()) < DEPENDS:
        shares = _seldom(found, shares)
    if "time" in shares:
        shares["time"] = max(shares["time"], _share_of_line(found), parameter_drift(found)[1])
    return sorted(shares.items(), key=lambda pair: -pair[1])


def step_shares(found: Unexplained) -> dict[str, float]:
    """Share of the variance that a step function of each variable alone explains in all recordings."""
    return _shares(found, found.recording)


def _seldom(found: Unexplained, shares: Mapping[str, float]) -> dict[str, float]:
    """The shares with those of the variables, and of the hub's travel, that explain some stretches by others."""
    with_travel = {name: found.variables[name] for name in shares} | _travel(found)
    shares = dict.fromkeys(with_travel, 0.0) | dict(shares)
    found = replace(found, variables=with_travel)
    by_stretch = _shares(found, np.floor(found.time / _STRETCH).astype(int))
    return {name: by_stretch[name] if by_stretch[name] > DEPENDS else s for name, s in shares.items()}


def _travel(found: Unexplained) -> dict[str, np.ndarray]:
    """How far the hub has turned since it last turned round or was seen first (n) [rad]; none of a clamped one."""
    if not {"hub_angle", "hub_rate"} <= found.variables.keys():
        return {}
    angle, rate = found.variables["hub_angle"], found.variables["hub_rate"]
    anew = (np.diff(np.sign(rate)) != 0) | (np.diff(found.time) > _UNSEEN) | (np.diff(found.recording) != 0)
    first = np.maximum.accumulate(np.where(np.append(True, anew), np.arange(len(angle)), 0))
    return {TRAVEL: angle - angle[first]}


def _shares(found: Unexplained, part: np.ndarray) -> dict[str, float]:
    return {name: _cross_share(found.values, v, part) for name, v in found.variables.items()}


def _best_pair(found: Unexplained) -> tuple[tuple[str, ...], float]:
    """The two variables whose step function, over both, explains most of the variance, and the share."""
    _, part = np.unique(found.recording, return_inverse=True)
    cells = {name: np.searchsorted(_edges(v, _COARSE), v) for name, v in found.variables.items()}
    shares = {
        (a, b): _share_in_cells(found.values, cells[a] * _COARSE + cells[b], part, _COARSE**2)
        for a, b in combinations(sorted(cells, key=lambda name: name != "time"), 2)
    }
    return max(shares.items(), key=lambda item: item[1], default=((), 0.0))


def _share_of_line(found: Unexplained) -> float:
    """Share of the variance that an oscillation explains, its frequency told by the other recordings; 0 without any.

    It counts where it is a line and what swings most: what is missing in a link spreads about where that rings.
    Where the link rings, whatever is missing in it does so.
    """
    inside = [found.recording == i for i in np.unique(found.recording)]
    if len(inside) < 2:
        return 0.0
    time = [found.time[k] - found.time[k][0] for k in inside]
    size = next_fast_len(2 * round(max(t[-1] for t in time) / GRID) + 2)
    frequency = rfftfreq(size, GRID)
    sought = (frequency > _SLOWEST) & (frequency < BAND)
    resolved = _LOBE / float(np.median([t[-1] for t in time]))
    for ring in found.rings:
        sought &= np.abs(frequency - ring) > max(_BESIDE * ring, resolved)
    if not sought.any():
        return 0.0
    power = np.array([_power(found.white[k], t, size) for k, t in zip(inside, time, strict=True)])[:, sought]
    gained = 0.0
    most = _LOUD * float(np.median(np.abs(found.white)))
    for k, t, own in zip(inside, time, power, strict=True):
        others = power.sum(0) - own
        told = frequency[sought][np.argmax(others)]
        about = np.abs(frequency[sought] - told) < _ABOUT
        alike = abs(frequency[sought][np.argmax(own)] - told) < _LOBE / t[-1]
        if not alike or others.max() < _SHARP * np.median(others[about]):
            continue
        line = 2 * np.pi * told * t
        columns = np.column_stack([np.cos(line), np.sin(line)])
        usual = np.clip(found.white[k], -most, most)
        gained += usual @ columns @ np.linalg.lstsq(columns, usual, rcond=None)[0]
    return float(gained / np.sum(np.clip(found.white, -most, most) ** 2))


def parameter_drift(found: Unexplained) -> tuple[str, float]:
    """The parameter that explains most if it changes with the time since a recording began, and of what variance.

    What such a parameter leaves swings as the link does: its mean over a piece of time is next to nothing. No name and
    0 where none explains any.
    """
    _, part = np.unique(found.recording, return_inverse=True)
    cell = np.searchsorted(_edges(found.variables["time"], _COARSE), found.variables["time"])
    shares = {
        name: _share_in_cells(found.white, cell, part, _COARSE, slope)
        for name, slope in found.slopes.items()
        if np.any(slope)
    }
    return max(shares.items(), key=lambda pair: pair[1], default=("", 0.0))


def _is_knocks(found: Unexplained) -> bool:
    """Whether most of the variance is in a few short pieces of time, and all others are but noise.

    A hub that runs into a stop shows so, too, in what its link reads: no variable may tell more of any channel.
    """
    _, piece = np.unique(np.floor(found.time / _KNOCK), return_inverse=True)
    count, power = np.bincount(piece), np.bincount(piece, found.white**2)
    quietest = np.argsort(power / count)
    size = np.sqrt(np.cumsum(power[quietest]) / np.cumsum(count[quietest]))
    quiet = quietest[size <= ADEQUATE_RMS]
    return bool(2 * power[quiet].sum() < power.sum() and len(quiet) > (1 - _SELDOM) * len(count))


def _power(white: np.ndarray, time: np.ndarray, size: int) -> np.ndarray:
    """Periodogram of residuals (m) at instants of the grid (m) [s], zeros between and behind them."""
    signal = np.zeros(size)
    signal[np.round(time / GRID).astype(int)] = white
    return np.abs(rfft(signal)) ** 2 / len(white)


def _cross_share(values: np.ndarray, variable: np.ndarray, part: np.ndarray) -> float:
    """Share of the variance of values (n) that a step function of a variable (n) explains in each part of them (n).

    Its means come from the other parts, its bins are wide or narrow ones: a dead zone is a narrow fault.
    """
    _, part = np.unique(part, return_inverse=True)
    return max(
        _share_in_cells(values, np.searchsorted(_edges(variable, count), variable), part, count)
        for count in _BINS
    )


def _edges(variable: np.ndarray, count: int) -> np.ndarray:
    """Inner edges (count - 1) of so many bins with as many samples each."""
    return np.quantile(variable, np.linspace(0, 1, count + 1)[1:-1])


def _share_in_cells(
    values: np.ndarray, cell: np.ndarray, part: np.ndarray, count: int, slope: np.ndarray | None = None
) -> float:
    """Share of the variance of values (n) that the means of their cells (n) explain, taken from the other parts (n).

    With a slope (n), it is a multiple of that in each cell.
    """
    slope = np.ones(len(values)) if slope is None else slope
    here = part * count + cell
    size = (part.max() + 1) * count
    sums, squares, counts = (
        np.bincount(here, w, size).reshape(-1, count) for w in (values * slope, slope**2, None)
    )
    others, elsewhere = squares.sum(0) - squares, counts.sum(0) - counts
    told = (elsewhere > _FEWEST) & (others > 0)
    means = np.where(told, (sums.sum(0) - sums) / np.where(told, others, 1.0), 0.0)
    left = np.sum((values - means.ravel()[here] * slope) ** 2)
    return max(0.0, 1 - float(left / np.sum(values**2)))


def strongest_variables(left: Sequence[Unexplained]) -> tuple[str, ...]:
    """Variables that explain most of some channels, best first, those that explain next to nothing left out.

    Where none explains anything, knocks at instants that nothing tells depend on time.
    """
    best: dict[str, float] = {}
    for found in left:
        for name, share in variance_shares(found):
            best[name] = max(best.get(name, 0.0), share)
    told = tuple(name for name, share in sorted(best.items(), key=lambda p: -p[1]) if share > DEPENDS)
    return told or (("time",) if any(map(_is_knocks, left)) else ())
