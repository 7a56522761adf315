"""One estimate of all declared parameters from all fit recordings: the calibration of the diagnosis, taken further.

The calibration starts a last fit in the limit of a fine chain; what the last power of the extrapolation came to counts
as error. The covariance is that of the residuals as they are (`scatter`), which is neither what the weights take them
for nor more. The errors are checked: each recording is left out in turn, and those that contradict the others are
named; where recordings disagree by more than their noise, the errors grow (`disagreement`). Where the likelihood is no
ellipse, intervals are by its profile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from twin.campaigns.campaign import Campaign
from twin.campaigns.clock import Clock
from twin.estimation import chain_limit, jackknife, refine, sandwich
from twin.estimation.calibrate import calibrate, late_command_notes
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.sandwich import RecordingInformation
from twin.estimation.slopes import costs_at, normal_equations, row_weights
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench
from twin.identification.estimates import TWO_SIDED_95, Estimate, positive
from twin.identification.likelihood_profile import Profile
from twin.parameters import Rig, relative_uncertainty
from twin.progress import Progress
from twin.recording import Recording
from twin.residuals.data import DrivenData
from twin.residuals.filters import MOTION_BANDS
from twin.residuals.prepared import Prepared

BANDS = (100.0, *MOTION_BANDS)
"""Corners of the low-pass on the motion of the hub [Hz]: an identification follows its harmonics further up."""
_ITERATIONS = 4
_CONTRADICTED = 4.0  # times as much variance as the noise makes, from which recordings contradict each other
_CHANCE = 0.01  # probability that no recording disagrees as much with the others as one is allowed to
_TIED = 0.9  # correlation from which two parameters are said to move together
_END = 1e-6  # share of a range up to which a value stands at its end
_ELLIPTIC = (0.25, 4.0)  # rise of the cost two standard errors away, over that of an ellipse


@dataclass(frozen=True)
class Joint:
    """The joint estimate.

    Attributes:
      fit: the last fit.
      readings: the fit recordings, without readings that are no measurements.
      bench: what it was fitted on.
      clock: when commands act.
      names: (p) parameters that were free: those of the rig, and effect.parameter of the effects that it is known to
        have.
      values: (p) estimate.
      covariance: (p x p).
      recordings: that were fitted.
      odd: (recording, parameter, distance) of estimates that move by more than chance without that recording, in
        standard errors of the move.
      rises: (p x 2) cost two standard errors below and above, over what an ellipse would have, others giving way.
      intervals: parameter -> 95 % interval by the profile of the likelihood, where that is no ellipse.
      notes: what was left out of the recordings or assumed of them.
    """

    fit: Fit
    readings: tuple[Recording, ...]
    bench: Workbench
    clock: Clock
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    recordings: tuple[str, ...]
    odd: tuple[tuple[str, str, float], ...]
    rises: np.ndarray
    intervals: Mapping[str, tuple[float, float]]
    notes: tuple[str, ...]

    @property
    def prepared(self) -> tuple[Prepared, ...]:
        """The recordings, made ready."""
        return self.bench.prepared

    @property
    def data(self) -> DrivenData:
        """The recordings, the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p x p) of what the recordings and the declared uncertainty leave open."""
        return self.covariance / np.outer(self.errors, self.errors)

    def tied(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters that move together, with their correlation, the closest first."""
        r = self.correlation
        pairs = [
            (self.names[i], self.names[j], float(r[i, j]))
            for i in range(len(r))
            for j in range(i + 1, len(r))
        ]
        return sorted((p for p in pairs if abs(p[2]) > _TIED), key=lambda p: -abs(p[2]))

    def at_an_end(self) -> list[str]:
        """Parameters that stand where their declared uncertainty, taken far, ends."""
        found = []
        for u, value in zip(self.fit.unknowns, self.fit.values, strict=True):
            low, high = u.bounds
            if u.is_parameter and min(value - low, high - value) < _END * (high - low):
                found.append(u.full_name)
        return found

    def estimate(self, name: str) -> Estimate:
        """A parameter with its interval: by its profile where there is one, and within the range looked at."""
        k = self.names.index(name)
        said = Estimate(float(self.values[k]), float(self.errors[k]), self.intervals.get(name))
        low, high = self.range_of(name)
        first, last = said.interval
        return (
            said
            if low <= first and last <= high
            else replace(said, profile=(max(first, low), min(last, high)))
        )

    def range_of(self, name: str) -> tuple[float, float]:
        """Values of a parameter that are looked at."""
        unknown = next(u for u in self.fit.unknowns if u.is_parameter and u.full_name == name)
        return _turned(unknown, *unknown.bounds)

    def not_elliptic(self) -> list[str]:
        """Parameters in which the likelihood two standard errors away is not that of an ellipse."""
        low, high = _ELLIPTIC
        return [
            name
            for name, rises in zip(self.names, self.rises, strict=True)
            if name != "static_friction" and (rises.min() < low or rises.max() > high)
        ]

    def open_ends(self, name: str) -> list[str]:
        """Sides, "lower" and "upper", on which a profile's interval ends where the range does."""
        low, high = self.range_of(name)
        near = _END * (high - low)
        first, last = self.intervals[name]
        return [side for side, gap in (("lower", first - low), ("upper", high - last)) if gap < near]

    def combination(self, a: str, b: str) -> tuple[float, float]:
        """The power s with which a b^s is known best, and its relative standard error [1]."""
        i, j = self.names.index(a), self.names.index(b)
        values = self.values[[i, j]]
        C = self.covariance[np.ix_([i, j], [i, j])] / np.outer(values, values)
        power = -float(C[0, 1] / C[1, 1])
        return power, float(np.sqrt(max(C[0, 0] - C[0, 1] ** 2 / C[1, 1], 0.0)))

    def figure(self, of: Callable[[Mapping[str, float]], float], rig: Mapping[str, float]) -> Estimate:
        """A positive figure of the rig at the estimate, with the covariance's error; `rig` has what is fixed."""
        values = {**rig, **dict(zip(self.names, self.values, strict=True))}
        here = of(values)
        slopes = np.array(
            [
                (of({**values, n: values[n] * 1.001}) - here) / (values[n] * 1e-3) if n in rig else 0.0
                for n in self.names
            ]
        )
        return positive(here, float(np.sqrt(slopes @ self.covariance @ slopes)))


def with_link(inertia: Estimate, found: Joint) -> Estimate:
    """J0 of the hub's balance, whose link is the identified one: as uncertain as the scale of that link's torque."""
    stiffness = found.names.index("bending_stiffness")
    scale = found.errors[stiffness] / found.values[stiffness]
    return Estimate(inertia.value, float(np.hypot(inertia.standard_error, inertia.value * scale)))


def estimate(
    campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress, told: Mapping[str, float]
) -> Joint:
    """Fits all declared parameters within their uncertainty, and checks the errors.

    Args:
      campaign: the recordings.
      pool: threads for the simulations.
      progress: told of every stage.
      told: parameter -> value by a procedure of its own, from which the fit starts.
    """
    start = calibrate(campaign, pool, progress, told)
    progress("fitting in the limit of a fine chain")
    bench = Workbench(DrivenData(start.prepared, start.base.model, BANDS), pool)
    bench, base, left = _in_the_limit(bench, start.base)
    progress("leaving recordings out")
    said = sandwich.recording_information(bench, base)
    recordings = tuple(p.recording.name for p in bench.prepared)
    distances = said.deletion_moves()
    rest = said.prior_covariance + np.outer(left, left)
    full = jackknife.inflated_covariance(
        said.noise_covariance, rest, *said.influences(), jackknife.largest_errors(base)
    )
    progress("looking along the likelihood")
    errors = np.sqrt(np.diag(full))
    rises = _rises(bench, base, errors)
    intervals = _profiles(bench, base, errors, said, rises)
    mine = [i for i, u in enumerate(base.unknowns) if u.is_parameter]
    names = tuple(base.unknowns[i].full_name for i in mine)
    # Of a stiffness that may be infinite, a fit moves one over it.
    turns = np.array([-1 / base.values[i] ** 2 if base.unknowns[i].inverse else 1.0 for i in mine])
    return Joint(
        base,
        start.readings,
        bench,
        start.clock,
        names,
        np.array([base.unknowns[i].turned(float(base.values[i])) for i in mine]),
        full[np.ix_(mine, mine)] * np.outer(turns, turns),
        recordings,
        _odd(recordings, names, distances[:, mine]),
        rises[mine],
        {
            n: _turned(base.unknowns[i], *intervals[i])
            for i, n in zip(mine, names, strict=True)
            if i in intervals
        },
        (*start.notes, *late_command_notes(base)),
    )


def _turned(unknown: Unknown, *ends: float) -> tuple[float, float]:
    low, high = sorted(unknown.turned(end) for end in ends)
    return low, high


def prior_deviation(rig: Rig, name: str) -> float:
    """Standard deviation of a declared parameter; 0 where it is exact."""
    return relative_uncertainty(rig.parameters[name]) * abs(rig[name])


def _in_the_limit(bench: Workbench, base: Fit) -> tuple[Workbench, Fit, np.ndarray]:
    """The data without the chain's own error, the fit to them, and what (p) the values may still be off by that error.

    The error is determined where the fit starts, and once more, with one chain more, where it stands.
    """
    kept = refine.observable(base)
    unknowns = [u for u, k in zip(base.unknowns, kept, strict=True) if k]
    bench, _ = chain_limit.without_discretisation_error(bench, base.model, base.starts, chain_limit.STANDARD)
    found = minimise(bench, base.model, base.starts, unknowns, base.values[kept], None, _ITERATIONS)
    bench, change = chain_limit.without_discretisation_error(
        bench, found.model, found.starts, chain_limit.PRECISE
    )
    found = refine.refined_fit(bench, found)
    information, _ = normal_equations(bench, found)
    pull = found.jacobian.T @ (row_weights(bench, found.residual) * change)
    return bench, found, -np.linalg.pinv(information, hermitian=True) @ pull


def _allowed(distances: np.ndarray) -> float:
    """The distance (k x p of them) that chance makes one exceed in so few cases."""
    return float(norm.isf(_CHANCE / 2 / distances.size))


def _odd(
    recordings: tuple[str, ...], names: tuple[str, ...], distances: np.ndarray
) -> tuple[tuple[str, str, float], ...]:
    """Recording, parameter and distance (k x p) wherever one disagrees with others, the farthest first."""
    if len(recordings) < 2:
        return ()
    found = [
        (recordings[i], names[k], float(abs(distances[i, k])))
        for i, k in zip(*np.nonzero(np.abs(distances) > _allowed(distances)), strict=True)
    ]
    return tuple(sorted(found, key=lambda f: -f[2]))


def _profiles(
    bench: Workbench, base: Fit, errors: np.ndarray, said: RecordingInformation, rises: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Unknown -> 95 % interval by the profile, where the likelihood (p x 2 rises) is no ellipse within its range."""
    low, high = _ELLIPTIC
    ratios = errors**2 / np.diag(said.inverse)
    half, ends = TWO_SIDED_95 * errors, np.array([u.bounds for u in base.unknowns])
    cut = (base.values - half < ends[:, 0]) | (base.values + half > ends[:, 1])
    # The static level is read at break-aways, not here.
    mine = np.array([u.is_parameter and u.name != "static_friction" for u in base.unknowns])
    # Where recordings contradict each other their errors are not those of the likelihood, and no rise of it is theirs.
    contradicted = errors**2 > _CONTRADICTED * np.diag(said.covariance)
    odd = np.flatnonzero(mine & ~contradicted & (cut | ((rises < low) | (rises > high)).any(axis=1)))
    inside = np.clip(np.column_stack([base.values - half, base.values + half]), ends[:, :1], ends[:, 1:])
    found = {}
    for k in odd:
        first, last = Profile(bench, base, int(k), float(errors[k]), float(ratios[k])).interval()
        # Others that are not quite at their best make a profile too steep, never too flat.
        found[int(k)] = min(first, float(inside[k, 0])), max(last, float(inside[k, 1]))
    return found


def _rises(bench: Workbench, base: Fit, errors: np.ndarray) -> np.ndarray:
    """Rise of the cost (p x 2) two standard errors (p) to either side, over that of an ellipse, others giving way."""
    information, _ = normal_equations(bench, base)
    covariance = np.linalg.pinv(information, hermitian=True)
    low, high = np.array([u.bounds for u in base.unknowns]).T
    points, expected = [], []
    for k in range(len(base.values)):
        for side in (-2.0, 2.0):
            away = side * errors[k] * covariance[:, k] / covariance[k, k]
            points.append(np.clip(base.values + away, low, high))
            moved = points[-1] - base.values
            expected.append(0.5 * moved @ information @ moved)
    costs = costs_at(bench, base.model, base.starts, base.unknowns, points)
    return ((costs - base.cost) / np.maximum(expected, 1e-3)).reshape(-1, 2)
