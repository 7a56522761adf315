"""Each recording as the others predict it: cross-validation within the recordings of a fit.

A fit without one of them is one step of Gauss and Newton away from the fit to all of them: no simulation more.
"""

from __future__ import annotations

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import bounded_move, normal_equations, row_weights
from twin.estimation.workbench import Workbench

_ALONE = 0.01  # part of what is known of a number below which the other recordings do not tell it


def residual(bench: Workbench, found: Fit, effect: str | None = None) -> np.ndarray:
    """Residual (n), that of each recording by a fit to the other ones.

    What a recording alone tells, as the state at its first sample, is kept as it is.

    Args:
      bench: the data.
      found: the fit to all of them, with its slopes.
      effect: the only one whose parameters are told by the others; all else stays as all recordings tell it.
    """
    weights = row_weights(bench, found.residual)
    information, gradient = normal_equations(bench, found)
    low, high = np.array([u.bounds for u in found.unknowns]).T - found.values
    mine = np.array([effect is None or u.owner == effect for u in found.unknowns])
    predicted = found.residual.copy()
    for i in {g.recording for g in bench.groups}:
        own = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in bench.groups if g.recording == i])
        J, weighted = found.jacobian[own], weights[own, None] * found.jacobian[own]
        others = information - J.T @ weighted
        told = mine & (np.diag(others) > _ALONE * np.diag(information))
        if not told.any():
            continue
        pulls = gradient - weighted.T @ found.residual[own]
        move = bounded_move(others[np.ix_(told, told)], pulls[told], low[told], high[told])
        predicted[own] += J[:, told] @ move * bench.weight[own]
    return predicted
