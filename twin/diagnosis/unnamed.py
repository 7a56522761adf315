"""Test for a missing torque on the hub that is a smooth function of one variable, but no effect of the library.

Such a torque may leave residuals that are small at each instant, but the same function of command, hub angle or time
in all recordings. It is a Gaussian process over the variable, whose standard deviation and length scale maximise the
marginal likelihood; the unknowns of the fit are nuisance parameters. The statistic is its log Bayes factor against no
function (evidence, see `twin.estimation.gaussian_process`). Its distribution where nothing is missing comes from the
sign-flip permutation test of `twin.diagnosis.permutation`.

Only the torque balance of the hub is tested, and the sensor of the motor torque for faults of the drive. Strains are
not: they differ by small smooth functions between simulators of the same sound rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.diagnosis import dependence, permutation
from twin.diagnosis.state import FunctionOf, UnnamedFunction
from twin.estimation.fit import Fit
from twin.estimation.gaussian_process import FunctionEvidence, maximise_evidence, posterior_mean
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench, reversal_weights
from twin.recording import HUB_TORQUE
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, low_passed
from twin.residuals.numerics import ROUNDING
from twin.residuals.prepared import Prepared
from twin.residuals.view import View
from twin.rigs.model import Model

_KNOTS = 32  # of the piecewise linear function
_RANGE = (0.002, 0.998)  # quantiles of the variable at the first and the last knot


_TORQUE, _COMMAND = "motor_torque", "torque_command"
_LAWS = (
    FunctionOf(_COMMAND, drive=True),
    *(FunctionOf(variable) for variable in ("torque_command", "hub_angle", "hub_rate", "time")),
    *(FunctionOf(variable, sided=True) for variable in ("hub_angle", "time")),
)


def find_functions(bench: Workbench, best: Fit, rate: float) -> tuple[UnnamedFunction, ...]:
    """The smooth functions behind the torque balance of the hub, that with the largest evidence first.

    Args:
      bench: the data.
      best: the fit of the model, with its Jacobian.
      rate: false-alarm rate of the threshold `by_chance`.

    Returns:
      All functions that were tested; empty if no recording has a free hub.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    variables = {
        g.recording: dependence.motion_variables(data, best, g.recording)
        for g in data.groups
        if g.channel == HUB_TORQUE
    }
    if not variables:
        return ()
    signs = permutation.random_signs(bench, permutation.DRAWS, np.random.default_rng(permutation.SEED))
    linearised = _Linearised.of(bench, best)
    bases = [(law, _basis(bench, best, variables, law)) for law in _LAWS]
    tested = [(law, b, _evidence(linearised, b, signs)) for law, b in bases if b is not None]
    if not tested:
        return ()
    largest = np.max([e.by_draw for _, _, (e, _) in tested], axis=0, initial=0.0)
    by_chance = permutation.threshold(np.sort(largest), rate)
    functions = [UnnamedFunction(law, e.value, by_chance, b.x, y, b.samples) for law, b, (e, y) in tested]
    return tuple(sorted(functions, key=lambda n: -n.evidence))


@dataclass(frozen=True, eq=False)
class _Basis:
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


def _basis(
    bench: Workbench, best: Fit, variables: Mapping[int, Mapping[str, np.ndarray]], law: FunctionOf
) -> _Basis | None:
    """The basis of a function; None if its variable does not vary or the drive has no torque sensor.

    Args:
      bench, best: the data and the fit.
      variables: recording with a free hub -> variable -> (m) its values.
      law: what the function depends on, and where it acts.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    on_hub = [g for g in data.groups if g.channel == HUB_TORQUE]
    read = [g for g in data.groups if g.channel == _TORQUE and law.drive]
    if law.drive and not read:
        return None
    values = np.concatenate([variables[g.recording][law.variable][bench.weight[g.rows] > 0] for g in on_hub])
    low, high = np.quantile(values, _RANGE)
    if not high > low:
        return None
    x = np.linspace(low, high, _KNOTS)
    groups = sorted([*on_hub, *read], key=lambda g: g.rows.start)
    parts = [
        _on_hub(data.views[g.recording], variables[g.recording], law, x) / best.model.torque_gain
        if g.channel == HUB_TORQUE
        else _on_reading(data.views[g.recording], data.prepared[g.recording], best.model, x)
        for g in groups
    ]
    columns = [bench.weight[g.rows, None] * part.T for g, part in zip(groups, parts, strict=True)]
    rows = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in groups])
    nearest = np.round((np.clip(values, low, high) - low) / (x[1] - x[0])).astype(int)
    return _Basis(x, np.concatenate(columns), rows, np.bincount(nearest, minlength=_KNOTS))


def _hats(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Weight (k x m) of each knot at some values (m): linear interpolation, constant beyond the ends."""
    position = np.clip((values - x[0]) / (x[1] - x[0]), 0, len(x) - 1)
    return np.maximum(1 - np.abs(position - np.arange(len(x))[:, None]), 0.0)


def _on_hub(view: View, variables: Mapping[str, np.ndarray], law: FunctionOf, x: np.ndarray) -> np.ndarray:
    """Derivative (k x m) of the whitened torque balance of one recording by the value at each knot."""
    added = _hats(variables[law.variable], x)
    if law.sided:
        added *= np.sign(variables["hub_rate"])
    if law.sided or law.variable == _COMMAND:
        # In the balance, friction and drive torque pass the low-pass of the motion as well.
        added = low_passed(added, GRID, view.band)
    return -residual.normalise(view.sliding * low_passed(added, GRID), view, HUB_TORQUE)


def _on_reading(view: View, prepared: Prepared, model: Model, x: np.ndarray) -> np.ndarray:
    """Derivative (k x m) of the whitened residual of the motor torque sensor by the value at each knot."""
    time = prepared.recording.time
    read = _hats(model.read_torque(prepared.recording), x)
    added = low_passed(np.array([np.interp(view.time, time, row) for row in read]), GRID)
    return -residual.normalise(view.known[_TORQUE] * added, view, _TORQUE)


@dataclass(frozen=True, eq=False)
class _Linearised:
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
    def of(cls, bench: Workbench, base: Fit) -> _Linearised:
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


def _evidence(
    linearised: _Linearised, basis: _Basis, signs: np.ndarray
) -> tuple[FunctionEvidence, np.ndarray]:
    """Evidence of a function beside the unknowns of the fit, and the function (k) that corrects the fit as it is [N m].

    The unknowns are eliminated from information and gradient by their Schur complement.
    """
    weights, columns = linearised.weights[basis.rows], basis.columns
    shared = linearised.slopes[basis.rows].T @ (weights[:, None] * columns)
    eliminated = np.linalg.solve(linearised.information, shared)
    alone = columns.T @ (weights[:, None] * columns)
    weighted, stretch = linearised.weighted[basis.rows, None], linearised.stretch[basis.rows]
    own = _sums_by_stretch(columns * weighted, stretch, signs.shape[1])
    gradient = own.sum(0) - (linearised.gradients.sum(0) + linearised.prior_gradient) @ eliminated
    flipped = signs @ (own - linearised.gradients @ eliminated)
    evidence = maximise_evidence(alone - shared.T @ eliminated, gradient, flipped)
    return evidence, posterior_mean(alone, own.sum(0), evidence.length, evidence.size)


def _sums_by_stretch(values: np.ndarray, stretch: np.ndarray, count: int) -> np.ndarray:
    """Sums (g x k) of rows (r x k) over each stretch, whose rows are contiguous."""
    sums = np.zeros((count, values.shape[1]))
    first = np.flatnonzero(np.diff(stretch, prepend=-1))
    sums[stretch[first]] = np.add.reduceat(values, first)
    return sums
