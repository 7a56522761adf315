"""Joint estimate of all declared parameters from all fit recordings.

The calibration of a diagnosis starts a last maximum-a-posteriori fit in the limit of a fine chain; the remaining
discretisation error counts as error. The covariance is the sandwich covariance of the coloured residuals (`sandwich`).
Each recording is left out in turn, and recordings that contradict the others are named; where recordings disagree by
more than their noise, the errors grow (`jackknife`). Where the log-likelihood is not quadratic, intervals are those of
the profile likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from twin.campaigns.campaign import Campaign
from twin.campaigns.clock import Clock
from twin.estimation import chain_limit, jackknife, refine, sandwich
from twin.estimation.calibrate import calibrate, late_command_notes
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.sandwich import RecordingInformation
from twin.estimation.slopes import costs_at, normal_equations, row_weights
from twin.estimation.unknowns import Unknown
from twin.estimation.workbench import Workbench, driven_data
from twin.identification.estimates import TWO_SIDED_95, Estimate, positive_estimate
from twin.identification.likelihood_profile import Profile
from twin.parameters import Rig, relative_uncertainty
from twin.progress import Progress
from twin.recording import Recording
from twin.residuals.data import DrivenData
from twin.residuals.filters import MOTION_BANDS
from twin.residuals.prepared import Prepared

BANDS = (100.0, *MOTION_BANDS)
"""Corners of the low-pass on the hub motion [Hz]; 100 Hz beside those of a diagnosis keeps more of its harmonics."""
_ITERATIONS = 4  # of the fit before the last one
_MAX_VARIANCE_RATIO = 4.0  # variance over that by noise above which recordings contradict each other [1]
_FALSE_ALARM_RATE = 0.01  # probability that noise alone makes a recording contradict the others [1]
_MIN_CORRELATION = 0.9  # correlation from which a pair of parameters is reported [1]
_BOUND_TOLERANCE = 1e-6  # share of its range within which a value is at a bound [1]
_QUADRATIC_RANGE = (0.25, 4.0)
"""Rise of the cost at two standard errors over that of the quadratic approximation [1], within which it holds."""


@dataclass(frozen=True)
class JointEstimate:
    """Joint estimate of p parameters.

    Attributes:
      fit: the last fit.
      readings: the fit recordings, without defective readings.
      bench: data that the fit was made on.
      clock: when commands act.
      names: (p) estimated parameters: of the rig, and effect.parameter of declared effects.
      values: (p) estimates, SI.
      covariance: (p x p).
      recordings: names of the fit recordings.
      contradictions: (recording, parameter, distance) wherever the estimate moves by more than chance if a recording is
        left out; the distance is in standard errors of the move.
      cost_rise_ratios: (p x 2) rise of the cost at two standard errors below and above, over that of the quadratic
        approximation, the other parameters moved along.
      intervals: parameter -> 95 % interval by the profile likelihood, where the log-likelihood is not quadratic.
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
    contradictions: tuple[tuple[str, str, float], ...]
    cost_rise_ratios: np.ndarray
    intervals: Mapping[str, tuple[float, float]]
    notes: tuple[str, ...]

    @property
    def prepared(self) -> tuple[Prepared, ...]:
        """The prepared recordings."""
        return self.bench.prepared

    @property
    def data(self) -> DrivenData:
        """The recordings, with the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, DrivenData)
        return self.bench.data

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p x p)."""
        return self.covariance / np.outer(self.errors, self.errors)

    def correlated_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters with a correlation above `_MIN_CORRELATION`, and their correlation, largest first."""
        r = self.correlation
        pairs = [
            (self.names[i], self.names[j], float(r[i, j]))
            for i in range(len(r))
            for j in range(i + 1, len(r))
        ]
        return sorted((p for p in pairs if abs(p[2]) > _MIN_CORRELATION), key=lambda p: -abs(p[2]))

    def at_bounds(self) -> list[str]:
        """Parameters whose estimate is at a bound of their range."""
        names = []
        for u, value in zip(self.fit.unknowns, self.fit.values, strict=True):
            low, high = u.bounds
            if u.is_parameter and min(value - low, high - value) < _BOUND_TOLERANCE * (high - low):
                names.append(u.full_name)
        return names

    def estimate(self, name: str) -> Estimate:
        """A parameter with its interval, by profile likelihood where there is one, cut off at the bounds."""
        k = self.names.index(name)
        whole = Estimate(float(self.values[k]), float(self.errors[k]), self.intervals.get(name))
        low, high = self.range_of(name)
        first, last = whole.interval
        if low <= first and last <= high:
            return whole
        return replace(whole, profile=(max(first, low), min(last, high)))

    def range_of(self, name: str) -> tuple[float, float]:
        """Bounds of a parameter in the fit."""
        unknown = next(u for u in self.fit.unknowns if u.is_parameter and u.full_name == name)
        return _to_parameter_interval(unknown, *unknown.bounds)

    def non_quadratic(self) -> list[str]:
        """Parameters in which the log-likelihood is not quadratic within two standard errors."""
        low, high = _QUADRATIC_RANGE
        return [
            name
            for name, ratios in zip(self.names, self.cost_rise_ratios, strict=True)
            if name != "static_friction" and (ratios.min() < low or ratios.max() > high)
        ]

    def truncated_sides(self, name: str) -> list[str]:
        """Sides, "lower" and "upper", on which the profile interval of a parameter ends at its bound."""
        low, high = self.range_of(name)
        near = _BOUND_TOLERANCE * (high - low if np.isfinite(high - low) else abs(low))
        first, last = self.intervals[name]
        return [side for side, gap in (("lower", first - low), ("upper", high - last)) if gap < near]

    def best_known_product(self, a: str, b: str) -> tuple[float, float]:
        """The power s for which a b^s has the least relative standard error, and that error [1]."""
        i, j = self.names.index(a), self.names.index(b)
        values = self.values[[i, j]]
        C = self.covariance[np.ix_([i, j], [i, j])] / np.outer(values, values)
        power = -float(C[0, 1] / C[1, 1])
        return power, float(np.sqrt(max(C[0, 0] - C[0, 1] ** 2 / C[1, 1], 0.0)))

    def derived_estimate(
        self, quantity: Callable[[Mapping[str, float]], float], rig: Mapping[str, float]
    ) -> Estimate:
        """Returns a positive function of the rig's parameters with its error by linear propagation.

        Args:
          quantity: function of the parameters.
          rig: values of the parameters that are not estimated.
        """
        values = {**rig, **dict(zip(self.names, self.values, strict=True))}
        here = quantity(values)
        slopes = np.array(
            [
                (quantity({**values, n: values[n] * 1.001}) - here) / (values[n] * 1e-3) if n in rig else 0.0
                for n in self.names
            ]
        )
        return positive_estimate(here, float(np.sqrt(slopes @ self.covariance @ slopes)))


def with_link_uncertainty(inertia: Estimate, joint: JointEstimate) -> Estimate:
    """J0 of the hub's balance with the error of the link's reaction, which scales with the bending stiffness."""
    if "bending_stiffness" not in joint.names:  # exact, or replaced by an effect
        return inertia
    stiffness = joint.names.index("bending_stiffness")
    scale = joint.errors[stiffness] / joint.values[stiffness]
    return Estimate(inertia.value, float(np.hypot(inertia.standard_error, inertia.value * scale)))


def joint_estimate(
    campaign: Campaign, pool: ResidualPool, progress: Progress, initial: Mapping[str, float]
) -> JointEstimate:
    """Fits all declared parameters with their uncertainty as prior, and checks the errors.

    Args:
      campaign: the recordings.
      pool: where residuals are computed.
      progress: called with a text at every stage.
      initial: parameter -> value from which the fit starts; the others start as declared.
    """
    calibration = calibrate(campaign, pool, progress, initial)
    progress("fitting in the limit of a fine chain")
    bench = Workbench(driven_data(calibration.prepared, calibration.base.model, pool, BANDS), pool)
    bench, base, chain_error = _fit_in_chain_limit(bench, calibration.base)
    progress("leaving recordings out")
    evidence = sandwich.recording_information(bench, base)
    distances = evidence.deletion_moves()
    other = evidence.prior_covariance + np.outer(chain_error, chain_error)
    covariance = jackknife.inflated_covariance(
        evidence.noise_covariance, other, *evidence.influences(), jackknife.largest_errors(base)
    )
    progress("evaluating the profile likelihood")
    errors = np.sqrt(np.diag(covariance))
    ratios = _cost_rise_ratios(bench, base, errors)
    intervals = _profile_intervals(bench, base, errors, evidence, ratios)
    # First states and the clock are nuisance parameters: they are left out.
    own = [i for i, u in enumerate(base.unknowns) if u.is_parameter]
    names = tuple(base.unknowns[i].full_name for i in own)
    # Derivative of a parameter by its unknown: a stiffness that may be infinite is fitted as its inverse.
    slopes = np.array([-1 / base.values[i] ** 2 if base.unknowns[i].inverse else 1.0 for i in own])
    recordings = tuple(p.recording.name for p in bench.prepared)
    return JointEstimate(
        base,
        calibration.readings,
        bench,
        calibration.clock,
        names,
        np.array([base.unknowns[i].turned(float(base.values[i])) for i in own]),
        covariance[np.ix_(own, own)] * np.outer(slopes, slopes),
        recordings,
        _contradictions(recordings, names, distances[:, own]),
        ratios[own],
        {
            n: _to_parameter_interval(base.unknowns[i], *intervals[i])
            for i, n in zip(own, names, strict=True)
            if i in intervals
        },
        (*calibration.notes, *late_command_notes(base)),
    )


def _to_parameter_interval(unknown: Unknown, *ends: float) -> tuple[float, float]:
    """Ends of an interval of an unknown as an interval of its parameter, in order."""
    low, high = sorted(unknown.turned(end) for end in ends)
    return low, high


def prior_deviation(rig: Rig, name: str) -> float:
    """Standard deviation of a declared parameter, SI; 0 where it is exact."""
    return relative_uncertainty(rig.parameters[name]) * abs(rig[name])


def _fit_in_chain_limit(bench: Workbench, base: Fit) -> tuple[Workbench, Fit, np.ndarray]:
    """Returns the data corrected for the chain's discretisation error, the fit to them, and the remaining error (p).

    The correction is computed where the fit starts, and once more, with one chain more, where it ends. The remaining
    error is the change of the estimate by the last order of the extrapolation.
    """
    kept = refine.observable(base)
    unknowns = [u for u, k in zip(base.unknowns, kept, strict=True) if k]
    bench, _ = chain_limit.without_discretisation_error(bench, base.model, base.starts, chain_limit.STANDARD)
    fit = minimise(bench, base.model, base.starts, unknowns, base.values[kept], None, _ITERATIONS)
    bench, change = chain_limit.without_discretisation_error(
        bench, fit.model, fit.starts, chain_limit.PRECISE
    )
    fit = refine.refined_fit(bench, fit)
    information, _ = normal_equations(bench, fit)
    gradient = fit.jacobian.T @ (row_weights(bench, fit.residual) * change)
    return bench, fit, -np.linalg.pinv(information, hermitian=True) @ gradient


def _distance_limit(distances: np.ndarray) -> float:
    """Limit that normal distances (k x p) exceed anywhere with `_FALSE_ALARM_RATE`, by Bonferroni's correction."""
    return float(norm.isf(_FALSE_ALARM_RATE / 2 / distances.size))


def _contradictions(
    recordings: tuple[str, ...], names: tuple[str, ...], distances: np.ndarray
) -> tuple[tuple[str, str, float], ...]:
    """Recording, parameter and distance wherever a distance (k x p) exceeds the limit, largest first."""
    if len(recordings) < 2:
        return ()
    exceeded = [
        (recordings[i], names[k], float(abs(distances[i, k])))
        for i, k in zip(*np.nonzero(np.abs(distances) > _distance_limit(distances)), strict=True)
    ]
    return tuple(sorted(exceeded, key=lambda f: -f[2]))


def _profile_intervals(
    bench: Workbench, base: Fit, errors: np.ndarray, evidence: RecordingInformation, rises: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Returns unknown -> 95 % interval by profile likelihood, where the log-likelihood is not quadratic.

    Args:
      bench, base: the fit.
      errors: (p) standard errors.
      evidence: for the variance that the likelihood and the noise give.
      rises: (p x 2) as `JointEstimate.cost_rise_ratios`.
    """
    low, high = _QUADRATIC_RANGE
    ratios = errors**2 / np.diag(evidence.inverse)
    half, bounds = TWO_SIDED_95 * errors, np.array([u.bounds for u in base.unknowns])
    cut = (base.values - half < bounds[:, 0]) | (base.values + half > bounds[:, 1])
    # The static friction is read at break-aways instead.
    own = np.array([u.is_parameter and u.name != "static_friction" for u in base.unknowns])
    # Where recordings contradict each other, their errors are not those of the likelihood, and no profile gives them.
    contradicted = errors**2 > _MAX_VARIANCE_RATIO * np.diag(evidence.covariance)
    chosen = np.flatnonzero(own & ~contradicted & (cut | ((rises < low) | (rises > high)).any(axis=1)))
    normal = np.clip(np.column_stack([base.values - half, base.values + half]), bounds[:, :1], bounds[:, 1:])
    intervals = {}
    for k in chosen:
        first, last = Profile(bench, base, int(k), float(errors[k]), float(ratios[k])).interval()
        # An incomplete minimisation over the others makes a profile too steep, never too flat.
        intervals[int(k)] = min(first, float(normal[k, 0])), max(last, float(normal[k, 1]))
    return intervals


def _cost_rise_ratios(bench: Workbench, base: Fit, errors: np.ndarray) -> np.ndarray:
    """Rise of the cost (p x 2) at two standard errors (p) to either side over that of the quadratic approximation.

    The other unknowns move along the regression line on the one that is moved.
    """
    information, _ = normal_equations(bench, base)
    covariance = np.linalg.pinv(information, hermitian=True)
    low, high = np.array([u.bounds for u in base.unknowns]).T
    points, expected = [], []
    for k in range(len(base.values)):
        for side in (-2.0, 2.0):
            move = side * errors[k] * covariance[:, k] / covariance[k, k]
            points.append(np.clip(base.values + move, low, high))
            moved = points[-1] - base.values
            expected.append(0.5 * moved @ information @ moved)
    costs = costs_at(bench, base.model, base.starts, base.unknowns, points)
    return ((costs - base.cost) / np.maximum(expected, 1e-3)).reshape(-1, 2)
