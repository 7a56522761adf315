"""Confidence intervals by the profile likelihood, for parameters in which the log-likelihood is not quadratic.

The parameter is moved away from the estimate and the others are fitted again; the interval ends where the cost has
risen by 3.84/2, the 95 % quantile of chi-squared with one degree of freedom. The likelihood assumes a simpler noise
than there is and gives a variance C where it is V: the rise is scaled by V/C (R. E. Chandler and S. Bate, 2007).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from twin.estimation.fit import Fit
from twin.estimation.slopes import cost_of, normal_equations, normal_equations_at
from twin.estimation.unknowns import model_and_starts_at
from twin.estimation.workbench import Workbench
from twin.identification.estimates import TWO_SIDED_95

_MAX_DISTANCE = 6.0  # standard errors within which the ends are searched
_STEPS = 2  # Gauss-Newton steps of the other unknowns at each point
_TOLERANCE = 0.02  # of the ends, in standard errors


@dataclass(frozen=True)
class Profile:
    """Profile of a fit's cost along one parameter.

    Attributes:
      bench, base: the fit.
      index: of the parameter among its unknowns.
      error: its standard error.
      ratio: V/C, its variance over that of the likelihood [1].
    """

    bench: Workbench
    base: Fit
    index: int
    error: float
    ratio: float

    def interval(self) -> tuple[float, float]:
        """Returns the 95 % interval, cut off at the bounds of the parameter."""
        low, high = (self._end(side) for side in (-1.0, 1.0))
        return low, high

    def _end(self, side: float) -> float:
        """The lower (side -1) or upper (+1) end of the interval."""
        bounds = self.base.unknowns[self.index].bounds
        here = float(self.base.values[self.index])
        room = abs((bounds[1] if side > 0 else bounds[0]) - here) / self.error
        reach = min(_MAX_DISTANCE, room)

        def excess(distance: float) -> float:
            return self.signed_root(here + side * distance * self.error) - TWO_SIDED_95

        if reach <= 0 or excess(reach) <= 0:
            return here + side * reach * self.error
        return here + side * self.error * float(brentq(excess, 0.0, reach, xtol=_TOLERANCE))

    def signed_root(self, value: float) -> float:
        """Root of twice the rise of the profiled cost over V/C: 1.96 at an end; negative where the cost falls."""
        rise = self._profiled_cost(value) - self.base.cost
        return float(np.sign(rise) * np.sqrt(2 * abs(rise) / self.ratio))

    def _profiled_cost(self, value: float) -> float:
        """Least cost with the parameter held at a value, over the other unknowns."""
        bench, base = self.bench, self.base
        information, _ = normal_equations(bench, base)
        free = np.arange(len(base.values)) != self.index
        inverse = np.linalg.pinv(information[np.ix_(free, free)], hermitian=True)
        low, high = np.array([u.bounds for u in base.unknowns]).T
        x = base.values.copy()
        x[self.index] = value
        # Start at the conditional minimum of the quadratic approximation.
        x[free] -= inverse @ information[free, self.index] * (value - base.values[self.index])
        costs = []
        for step in range(_STEPS + 1):
            x = np.clip(x, low, high)
            [r] = bench.residuals([(*model_and_starts_at(base.model, base.starts, base.unknowns, x), None)])
            costs.append(cost_of(bench, base.unknowns, x, r))
            if step < _STEPS:
                _, gradient = normal_equations_at(bench, base.unknowns, x, r, base.jacobian)
                x[free] -= inverse @ gradient[free]
        return min(costs)
