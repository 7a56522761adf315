"""A fit linearised about its unknowns: the evidence of an unknown function in what it leaves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from twin.diagnosis import permutation
from twin.diagnosis.state import FunctionOf, UnnamedFunction
from twin.estimation.fit import Fit
from twin.estimation.gaussian_process import FunctionEvidence, maximise_evidence, posterior_mean
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench, reversal_weights
from twin.residuals.groups import Group
from twin.residuals.numerics import ROUNDING

_KNOTS = 32
"""Of a piecewise linear function: the shortest length scale that is tried, 0.05 of the range, is 1.5 times their
distance, see `gaussian_process.LENGTH_SCALES`."""
_RANGE = (0.002, 0.998)
"""Quantiles of the variable at the first and the last knot: few readings far out would leave most knots without any."""


@dataclass(frozen=True, eq=False)
class Basis:
    """A piecewise linear function of one variable, as derivatives of the residual.

    Attributes:
      x: (k) the knots, SI.
      columns: (r x k) derivative of the residual by the value at each knot.
      rows: (r) indices of these rows of the residual, ascending.
      samples: (k) number of samples nearest to each knot.
    """

    x: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    samples: np.ndarray

    @classmethod
    def of(
        cls,
        bench: Workbench,
        groups: Sequence[Group],
        parts: Sequence[np.ndarray],
        x: np.ndarray,
        samples: np.ndarray,
    ) -> Basis:
        """The basis of a function that changes some rows.

        Args:
          bench: the data.
          groups: the rows, ascending.
          parts: of each group, the derivative (k x r) of its residual by the value at each knot.
          x, samples: (k) the knots, and the number of samples nearest to each.
        """
        columns = [bench.scale[g.rows, None] * part.T for g, part in zip(groups, parts, strict=True)]
        rows = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in groups])
        return cls(x, np.concatenate(columns), rows, samples)


def knots(values: np.ndarray) -> np.ndarray | None:
    """Evenly spaced knots (k) over the range of a variable's values (m); None if it does not vary."""
    low, high = np.quantile(values, _RANGE)
    return np.linspace(low, high, _KNOTS) if high > low else None


def samples_at(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Number of values (m) nearest to each knot (k)."""
    nearest = np.round((np.clip(values, x[0], x[-1]) - x[0]) / (x[1] - x[0])).astype(int)
    return np.bincount(nearest, minlength=len(x))


def hats(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weight (k x m) of each knot at some values (m): linear interpolation, constant beyond the ends."""
    position = np.clip((values - x[0]) / (x[1] - x[0]), 0, len(x) - 1)
    return np.maximum(1 - np.abs(position - np.arange(len(x))[:, None]), 0.0)


@dataclass(frozen=True, eq=False)
class Linearised:
    """A fit linearised about its unknowns, the nuisance parameters of the test.

    Attributes:
      weights: (n) of the residual.
      weighted: (n) the residual times its weights.
      slopes: (n x p) derivatives of the residual by the unknowns, scaled to unit information.
      information: (p x p) of the unknowns.
      gradients: (g x p) of the cost of each stretch.
      prior_gradient: (p) of the priors.
      stretch: (n) index of the stretch of each row.
    """

    weights: np.ndarray
    weighted: np.ndarray
    slopes: np.ndarray
    information: np.ndarray
    gradients: np.ndarray
    prior_gradient: np.ndarray
    stretch: np.ndarray

    @classmethod
    def of(cls, bench: Workbench, base: Fit) -> Linearised:
        """The linearisation of a fit with its Jacobian."""
        weights = row_weights(bench, base.residual) * reversal_weights(bench, base)
        prior = prior_precision(base.unknowns)
        diagonal = base.jacobian.T**2 @ weights + prior
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        slopes = base.jacobian / scale
        away = np.array([v - u.start for u, v in zip(base.unknowns, base.values, strict=True)])
        information = slopes.T @ (weights[:, None] * slopes) + np.diag(prior / scale**2 + ROUNDING)
        lengths = [g.rows.stop - g.rows.start for g in bench.groups]
        stretch = np.repeat(np.arange(len(bench.groups)), lengths)
        weighted = base.residual * weights
        gradients = _sums_by_stretch(slopes * weighted[:, None], stretch, len(lengths))
        return cls(weights, weighted, slopes, information, gradients, prior * away / scale, stretch)

    def evidence(self, basis: Basis, signs: np.ndarray) -> tuple[FunctionEvidence, np.ndarray]:
        """Evidence of a function beside the unknowns of the fit, and the function (k) that corrects the fit as it is.

        The unknowns are eliminated from information and gradient by their Schur complement.

        Args:
          basis: the function.
          signs: of the stretches in each draw of the permutation test (d x g).
        """
        weights, columns = self.weights[basis.rows], basis.columns
        shared = self.slopes[basis.rows].T @ (weights[:, None] * columns)
        eliminated = np.linalg.solve(self.information, shared)
        alone = columns.T @ (weights[:, None] * columns)
        weighted, stretch = self.weighted[basis.rows, None], self.stretch[basis.rows]
        own = _sums_by_stretch(columns * weighted, stretch, signs.shape[1])
        gradient = own.sum(0) - (self.gradients.sum(0) + self.prior_gradient) @ eliminated
        flipped = signs @ (own - self.gradients @ eliminated)
        found = maximise_evidence(alone - shared.T @ eliminated, gradient, flipped)
        return found, posterior_mean(alone, own.sum(0), found.length, found.size)


def tried_functions(
    bench: Workbench, best: Fit, bases: Iterable[tuple[FunctionOf, Basis]], rate: float
) -> tuple[UnnamedFunction, ...]:
    """Functions with their evidence, the largest first.

    Args:
      bench, best: the data, and the fit with its Jacobian.
      bases: each function with its basis.
      rate: false-alarm rate of the threshold `by_chance`.
    """
    signs = permutation.random_signs(bench, permutation.DRAWS, np.random.default_rng(permutation.SEED))
    linearised = Linearised.of(bench, best)
    tried = [(law, b, linearised.evidence(b, signs)) for law, b in bases]
    if not tried:
        return ()
    largest = np.max([e.by_draw for _, _, (e, _) in tried], axis=0, initial=0.0)
    by_chance = permutation.threshold(np.sort(largest), rate)
    functions = [UnnamedFunction(law, e.value, by_chance, b.x, y, b.samples) for law, b, (e, y) in tried]
    return tuple(sorted(functions, key=lambda n: -n.evidence))


def _sums_by_stretch(values: np.ndarray, stretch: np.ndarray, count: int) -> np.ndarray:
    """Sums (g x k) of rows (r x k) over each stretch, whose rows are contiguous."""
    sums = np.zeros((count, values.shape[1]))
    first = np.flatnonzero(np.diff(stretch, prepend=-1))
    sums[stretch[first]] = np.add.reduceat(values, first)
    return sums
