"""What no effect of the library explains, sought as a torque on the hub that is a smooth function of one variable.

A fault without a name may leave a residual that is small everywhere, and still the same function of the command, of
the hub's angle or of time wherever that comes back. Such a function is a Gaussian process here, as large and as smooth
as the recordings like it best, with declared parameters and adopted effects free to give way; what counts is its
evidence, see `twin.estimation.gaussian_process`. What chance gives comes from random signs, as in
`twin.diagnosis.chance`.

Only the hub is asked, and the sensor of the drive's torque about what the drive does with its command: where readings
of the link differ a little from the model's, so do sound links on other engines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.diagnosis import chance, regressors
from twin.diagnosis.state import FunctionOf, UnnamedFunction
from twin.estimation.fit import Fit
from twin.estimation.gaussian_process import FunctionEvidence, maximise_evidence, posterior_mean
from twin.estimation.slopes import prior_precision, row_weights
from twin.estimation.workbench import Workbench, reversal_weights
from twin.recording import HUB
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, low_passed
from twin.residuals.prepared import Prepared
from twin.residuals.view import View
from twin.rigs.model import Model

_KNOTS = 32
_RANGE = (0.002, 0.998)  # quantiles of the variable between which the knots lie
_LEAST = 1e-9  # part of a variance that keeps a matrix regular


_TORQUE, _COMMAND = "motor_torque", "torque_command"
_LAWS = (
    FunctionOf(_COMMAND, drive=True),
    *(FunctionOf(variable) for variable in ("torque_command", "hub_angle", "hub_rate", "time")),
    *(FunctionOf(variable, sided=True) for variable in ("hub_angle", "time")),
)


def find_functions(bench: Workbench, best: Fit, rate: float) -> tuple[UnnamedFunction, ...]:
    """The functions of one variable that may be behind what a model leaves on the hub, the likeliest first.

    Args:
      bench: the data.
      best: the fit of the model, with its slopes there.
      rate: how often chance may give the evidence that it is held against.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    moving = {
        g.recording: regressors.of_motion(data, best, g.recording) for g in data.groups if g.channel == HUB
    }
    if not moving:
        return ()
    signs = chance.random_signs(bench, chance.DRAWS, np.random.default_rng(0))
    given = _Given.of(bench, best)
    bases = [(law, _basis(bench, best, moving, law)) for law in _LAWS]
    asked = [(law, b, _evidences(given, b, signs)) for law, b in bases if b is not None]
    if not asked:
        return ()
    largest = np.max([e.by_draw for _, _, (e, _) in asked], axis=0, initial=0.0)
    by_chance = chance.threshold(np.sort(largest), rate)
    named = [UnnamedFunction(law, e.value, by_chance, b.x, y, b.samples) for law, b, (e, y) in asked]
    return tuple(sorted(named, key=lambda n: -n.evidence))


@dataclass(frozen=True, eq=False)
class _Basis:
    """Change of the residual with each knot's value.

    Attributes:
      x: (k) the knots.
      columns: (r x k).
      rows: (r) of the residual, ascending.
      samples: (k) about each knot.
    """

    x: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    samples: np.ndarray


def _basis(
    bench: Workbench, best: Fit, moving: Mapping[int, Mapping[str, np.ndarray]], law: FunctionOf
) -> _Basis | None:
    """The columns of a function, by how each recording with a free hub moves; None where nothing tells of it."""
    data = bench.data
    assert isinstance(data, DrivenData)
    on_hub = [g for g in data.groups if g.channel == HUB]
    read = [g for g in data.groups if g.channel == _TORQUE and law.drive]
    if law.drive and not read:
        return None
    seen = np.concatenate([moving[g.recording][law.variable][bench.weight[g.rows] > 0] for g in on_hub])
    low, high = np.quantile(seen, _RANGE)
    if not high > low:
        return None
    x = np.linspace(low, high, _KNOTS)
    groups = sorted([*on_hub, *read], key=lambda g: g.rows.start)
    parts = [
        _on_hub(data.views[g.recording], moving[g.recording], law, x) / best.model.torque_gain
        if g.channel == HUB
        else _on_reading(data.views[g.recording], data.prepared[g.recording], best.model, x)
        for g in groups
    ]
    columns = [bench.weight[g.rows, None] * part.T for g, part in zip(groups, parts, strict=True)]
    rows = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in groups])
    nearest = np.round((np.clip(seen, low, high) - low) / (x[1] - x[0])).astype(int)
    return _Basis(x, np.concatenate(columns), rows, np.bincount(nearest, minlength=_KNOTS))


def _hats(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Share (k x m) of each knot in a function at some values (m): straight lines between knots, constant beyond."""
    place = np.clip((values - x[0]) / (x[1] - x[0]), 0, len(x) - 1)
    return np.maximum(1 - np.abs(place - np.arange(len(x))[:, None]), 0.0)


def _on_hub(view: View, known: Mapping[str, np.ndarray], law: FunctionOf, x: np.ndarray) -> np.ndarray:
    """Change of what the hub of one recording leaves (k x m) with the value at each knot."""
    added = _hats(known[law.variable], x)
    if law.sided:
        added *= np.sign(known["hub_rate"])
    if law.sided or law.variable == _COMMAND:
        # As friction and the drive's torque, which pass the filter of the motion, too.
        added = low_passed(added, GRID, view.band)
    return -residual.normalise(view.sliding * low_passed(added, GRID), view, HUB)


def _on_reading(view: View, prepared: Prepared, model: Model, x: np.ndarray) -> np.ndarray:
    """Change of what a reading of the drive's torque leaves (k x m) with the value at each knot."""
    time = prepared.recording.time
    read = _hats(model.read_torque(prepared.recording), x)
    added = low_passed(np.array([np.interp(view.time, time, row) for row in read]), GRID)
    return -residual.normalise(view.known[_TORQUE] * added, view, _TORQUE)


@dataclass(frozen=True, eq=False)
class _Given:
    """What a fit's own unknowns can do about a residual.

    Attributes:
      weights: (n) of the residual's rows.
      pulls: (n) the residual in noise units, weighted.
      slopes: (n x p) of the unknowns, each of size one.
      information: (p x p) of the unknowns.
      gradients: (g x p) of each stretch.
      pulled: (p) by how much their priors pull at them.
      block: (n) index of the stretch of each row.
    """

    weights: np.ndarray
    pulls: np.ndarray
    slopes: np.ndarray
    information: np.ndarray
    gradients: np.ndarray
    pulled: np.ndarray
    block: np.ndarray

    @classmethod
    def of(cls, bench: Workbench, base: Fit) -> _Given:
        weights = row_weights(bench, base.residual) * reversal_weights(bench, base)
        prior = prior_precision(base.unknowns)
        known = base.jacobian.T**2 @ weights + prior
        scale = np.sqrt(np.where(known > 0, known, 1.0))
        slopes = base.jacobian / scale
        away = np.array([v - u.start for u, v in zip(base.unknowns, base.values, strict=True)])
        information = slopes.T @ (weights[:, None] * slopes) + np.diag(prior / scale**2 + _LEAST)
        lengths = [g.rows.stop - g.rows.start for g in bench.groups]
        block = np.repeat(np.arange(len(bench.groups)), lengths)
        pulls = base.residual * weights
        gradients = _by_block(slopes * pulls[:, None], block, len(lengths))
        return cls(weights, pulls, slopes, information, gradients, prior * away / scale, block)


def _evidences(given: _Given, basis: _Basis, signs: np.ndarray) -> tuple[FunctionEvidence, np.ndarray]:
    """Evidence of a function with the fit's own unknowns free, and the function (k) that corrects the fit as it is."""
    weights, columns = given.weights[basis.rows], basis.columns
    shared = given.slopes[basis.rows].T @ (weights[:, None] * columns)
    beside = np.linalg.solve(given.information, shared)
    alone = columns.T @ (weights[:, None] * columns)
    own = _by_block(columns * given.pulls[basis.rows, None], given.block[basis.rows], signs.shape[1])
    gradient = own.sum(0) - (given.gradients.sum(0) + given.pulled) @ beside
    found = maximise_evidence(alone - shared.T @ beside, gradient, signs @ (own - given.gradients @ beside))
    return found, posterior_mean(alone, own.sum(0), found.length, found.size)


def _by_block(values: np.ndarray, block: np.ndarray, count: int) -> np.ndarray:
    """Sums of rows (r x k) over each stretch (g x k); rows of one stretch follow one another."""
    found = np.zeros((count, values.shape[1]))
    first = np.flatnonzero(np.diff(block, prepend=-1))
    found[block[first]] = np.add.reduceat(values, first)
    return found
