"""One estimate of all declared parameters from all fit recordings: the calibration of the diagnosis, taken further.

The calibration starts a last fit, with the hub's torque balance free of its grid's errors and the chain's own error
taken out on a much finer chain; what the step before that one changes counts as error. The errors are checked: each
recording is left out in turn, and where the estimate moves by more than the covariance allows, the errors grow
(B. Efron and C. Stein, 1981, the jackknife).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from twin import calibration, chain, fit, search
from twin.campaign import Campaign
from twin.fit import Fit, Prepared, Workbench
from twin.identify.exact_torque import ExactTorqueData
from twin.identify.results import Estimate
from twin.parameters import Rig
from twin.search import Progress, silent
from twin.timing import Clock

FINEST_SEGMENTS = 24
_FINER_BY = 4  # segments, the step in fineness that shows what error the finest chain may have left
_ITERATIONS = 4
_TIED = 0.9  # correlation from which two parameters are said to move together
_ELLIPTIC = (0.25, 4.0)  # rise of the cost two standard errors away, over that of an ellipse


@dataclass(frozen=True)
class Joint:
    """The joint estimate.

    Attributes:
      fit: the last fit.
      bench: what it was fitted on.
      clock: when commands act.
      names: (p) parameters of the rig that were free.
      values: (p) estimate.
      covariance: (p x p).
      linear_covariance: (p x p) before recordings were left out.
      without: recording -> (p) estimate without it.
      rises: (p x 2) cost two standard errors below and above, over what an ellipse would have, others giving way.
      notes: what was left out of the recordings or assumed of them.
    """

    fit: Fit
    bench: Workbench
    clock: Clock
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    linear_covariance: np.ndarray
    without: Mapping[str, np.ndarray]
    rises: np.ndarray
    notes: tuple[str, ...]

    @property
    def prepared(self) -> tuple[Prepared, ...]:
        """The recordings, made ready."""
        return self.bench.prepared

    @property
    def data(self) -> ExactTorqueData:
        """The recordings, the link driven by the measured hub angle."""
        assert isinstance(self.bench.data, ExactTorqueData)
        return self.bench.data

    @property
    def errors(self) -> np.ndarray:
        """Standard errors (p)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation matrix (p x p) of what the recordings and the declared uncertainty leave open."""
        errors = np.sqrt(np.diag(self.linear_covariance))
        return self.linear_covariance / np.outer(errors, errors)

    def tied(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters that move together, with their correlation, the closest first."""
        r = self.correlation
        pairs = [
            (self.names[i], self.names[j], float(r[i, j]))
            for i in range(len(r))
            for j in range(i + 1, len(r))
        ]
        return sorted((p for p in pairs if abs(p[2]) > _TIED), key=lambda p: -abs(p[2]))

    def combination(self, a: str, b: str) -> tuple[float, float]:
        """The power s with which a b^s is known best, and its relative standard error [1]."""
        i, j = self.names.index(a), self.names.index(b)
        values = self.values[[i, j]]
        C = self.covariance[np.ix_([i, j], [i, j])] / np.outer(values, values)
        power = -float(C[0, 1] / C[1, 1])
        return power, float(np.sqrt(max(C[0, 0] - C[0, 1] ** 2 / C[1, 1], 0.0)))

    def figure(self, of: Callable[[Mapping[str, float]], float], rig: Mapping[str, float]) -> Estimate:
        """A figure of the rig at the estimate, with the covariance's error; `rig` has the parameters that are fixed."""
        values = {**rig, **dict(zip(self.names, self.values, strict=True))}
        here = of(values)
        slopes = np.array(
            [(of({**values, n: values[n] * 1.001}) - here) / (values[n] * 1e-3) for n in self.names]
        )
        return Estimate(here, float(np.sqrt(slopes @ self.covariance @ slopes)))

    def not_elliptic(self) -> list[str]:
        """Parameters whose likelihood falls off otherwise than the covariance says."""
        low, high = _ELLIPTIC
        return [
            name
            for name, rises in zip(self.names, self.rises, strict=True)
            if not all(low <= rise <= high for rise in rises)
        ]


def estimate(campaign: Campaign, pool: ThreadPoolExecutor, progress: Progress = silent) -> Joint:
    """Fits all declared parameters within their uncertainty, and checks the errors."""
    start = calibration.calibrate(campaign, pool, progress)
    progress("fitting on a finer chain")
    bench = Workbench(ExactTorqueData(start.prepared, start.declared), pool)
    base = _on_finest_chain(bench, start.base)
    progress("leaving recordings out")
    mine = [i for i, u in enumerate(base.unknowns) if u.owner == "rig"]
    without = {name: x[mine] for name, x in _without_each(bench, base).items()}
    progress("comparing with a less fine chain")
    left = _discretisation(bench, base)
    linear = (base.covariance + np.outer(left, left))[np.ix_(mine, mine)]
    return Joint(
        base,
        bench,
        start.clock,
        tuple(base.unknowns[i].name for i in mine),
        base.values[mine],
        _widened(linear, np.array(list(without.values()))),
        linear,
        without,
        _rises(bench, base)[mine],
        start.notes,
    )


def prior_deviation(rig: Rig, name: str) -> float:
    """Standard deviation of a declared parameter, as said or as a careful lab would say; 0 where it is exact."""
    parameter = rig.parameters[name]
    relative = parameter.uncertainty
    if relative is None:
        relative = fit.ASSUMED_UNCERTAINTY.get(name, 0.0)
    return relative * abs(parameter.value)


def _refine(bench: Workbench, base: Fit, segments: int) -> None:
    shape = chain.fit_shape(base.model.declared, segments)
    bench.refine(base.model, base.model.replace(shape=shape, step=search.FINE_STEP), base.starts)


def _discretisation(bench: Workbench, base: Fit) -> np.ndarray:
    """How far (p) the finest chain may leave the estimate from the limit.

    What a chain a little less fine changes, by one Gauss-Newton step, carried on at the chain's second order
    (L. F. Richardson, 1911): n0^2/(n^2 - n0^2) of it are still to come.
    """
    finest = bench.defect
    _refine(bench, base, FINEST_SEGMENTS - _FINER_BY)
    change = (finest - bench.defect) * bench.weight
    bench.defect = finest
    information, _ = fit.normal_equations(bench, base)
    pull = base.jacobian.T @ (fit.row_weights(bench, base.residual) * change)
    coarser, finer = (FINEST_SEGMENTS - _FINER_BY) ** 2, FINEST_SEGMENTS**2
    return -np.linalg.pinv(information, hermitian=True) @ pull * coarser / (finer - coarser)


def _on_finest_chain(bench: Workbench, base: Fit) -> Fit:
    """The fit with the chain's own error taken out to the last: it is what is left where all else is right."""
    _refine(bench, base, FINEST_SEGMENTS)
    return fit.minimise(bench, base.model, base.starts, base.unknowns, base.values, None, _ITERATIONS)


def _without_each(bench: Workbench, base: Fit) -> dict[str, np.ndarray]:
    """Recording -> estimate (p) without it, by one Gauss-Newton step from the whole fit."""
    weights = fit.row_weights(bench, base.residual)
    information, gradient = fit.normal_equations(bench, base)
    of_row = np.repeat(
        [g.recording for g in bench.groups], [g.rows.stop - g.rows.start for g in bench.groups]
    )
    low, high = np.array([u.bounds for u in base.unknowns]).T
    found = {}
    for i, p in enumerate(bench.prepared):
        J, w = base.jacobian[of_row == i], weights[of_row == i]
        left = information - J.T @ (w[:, None] * J)
        pull = gradient - J.T @ (w * base.residual[of_row == i])
        step = np.linalg.pinv(left, hermitian=True) @ pull
        found[p.recording.name] = np.clip(base.values - step, low, high)
    return found


def _widened(linear: np.ndarray, without: np.ndarray) -> np.ndarray:
    """The covariance (p x p), its errors no smaller than the jackknife's over the estimates without a recording."""
    count = len(without)
    spread = np.sqrt((count - 1) * without.var(axis=0)) if count > 1 else np.zeros(len(linear))
    errors = np.sqrt(np.diag(linear))
    factor = np.maximum(1.0, spread / errors)
    return linear * np.outer(factor, factor)


def _rises(bench: Workbench, base: Fit) -> np.ndarray:
    """Rise of the cost (p x 2) two standard errors to either side, over the 2 of an ellipse, others giving way."""
    information, _ = fit.normal_equations(bench, base)
    covariance = np.linalg.pinv(information, hermitian=True)
    low, high = np.array([u.bounds for u in base.unknowns]).T
    points, expected = [], []
    for k in range(len(base.values)):
        for side in (-2.0, 2.0):
            away = side * covariance[:, k] / np.sqrt(covariance[k, k])
            points.append(np.clip(base.values + away, low, high))
            moved = points[-1] - base.values
            expected.append(0.5 * moved @ information @ moved)
    costs = fit.costs(bench, base.model, base.starts, base.unknowns, points)
    return ((costs - base.cost) / np.maximum(expected, 1e-3)).reshape(-1, 2)
