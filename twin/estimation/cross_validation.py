"""Leave-one-recording-out cross-validation of a fit, linearised.

A fit without one recording is one Gauss-Newton step away from the fit to all recordings: no simulation is needed.
"""

from __future__ import annotations

import numpy as np

from twin.estimation.fit import Fit
from twin.estimation.slopes import bounded_step, normal_equations, row_weights
from twin.estimation.workbench import Workbench

_DETERMINED = 0.01  # share of an unknown's information that the other recordings must have to determine it


def residual(bench: Workbench, base: Fit, effect: str | None = None) -> np.ndarray:
    """Residual (n) in which each recording is predicted with parameters fitted to the other recordings.

    Unknowns that one recording alone determines, such as its initial state, keep their values.

    Args:
      bench: the data.
      base: the fit to all of them, with its Jacobian.
      effect: refit only the parameters of this effect without the recording; None for all unknowns.
    """
    weights = row_weights(bench, base.residual)
    information, gradient = normal_equations(bench, base)
    low, high = np.array([u.bounds for u in base.unknowns]).T - base.values
    mine = np.array([effect is None or u.effect == effect for u in base.unknowns])
    predicted = base.residual.copy()
    for i in {g.recording for g in bench.groups}:
        own = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in bench.groups if g.recording == i])
        J, weighted = base.jacobian[own], weights[own, None] * base.jacobian[own]
        others = information - J.T @ weighted
        refitted = mine & (np.diag(others) > _DETERMINED * np.diag(information))
        if not refitted.any():
            continue
        score = gradient - weighted.T @ base.residual[own]
        step = bounded_step(
            others[np.ix_(refitted, refitted)], score[refitted], low[refitted], high[refitted]
        )
        predicted[own] += J[:, refitted] @ step * bench.weight[own]
    return predicted
