"""Intervals by the profile of the likelihood, for parameters in which it is no ellipse.

A parameter is moved away from the estimate and the others are fitted again; the interval ends where the cost has risen
by what a 95 % interval allows, 2 dl = 3.84. The likelihood takes the noise for simpler than it is, and says C for a
variance that is V: the rise that is allowed is 3.84 V/C (R. E. Chandler and S. Bate, 2007).
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

_FARTHEST = 6.0  # standard errors up to which an end is looked for
_STEPS = 2  # Gauss-Newton steps of the others at each point
_CLOSE = 0.02  # standard errors


@dataclass(frozen=True)
class Profile:
    """The cost of a fit along one parameter.

    Attributes:
      bench, base: the fit.
      index: of the parameter among its unknowns.
      error: its standard error.
      ratio: V/C, its variance over that of the likelihood.
    """

    bench: Workbench
    base: Fit
    index: int
    error: float
    ratio: float

    def interval(self) -> tuple[float, float]:
        """The 95 % interval; where the parameter's range ends before it does, that end."""
        low, high = (self._end(side) for side in (-1.0, 1.0))
        return low, high

    def _end(self, side: float) -> float:
        bounds = self.base.unknowns[self.index].bounds
        here = float(self.base.values[self.index])
        room = abs((bounds[1] if side > 0 else bounds[0]) - here) / self.error
        reach = min(_FARTHEST, room)

        def beyond(distance: float) -> float:
            return self.distance(here + side * distance * self.error) - TWO_SIDED_95

        if reach <= 0 or beyond(reach) <= 0:
            return here + side * reach * self.error
        return here + side * self.error * float(brentq(beyond, 0.0, reach, xtol=_CLOSE))

    def distance(self, value: float) -> float:
        """Signed root of the rise of the cost at a value of the parameter, in standard errors of an ellipse."""
        rise = self._least_cost(value) - self.base.cost
        return float(np.sign(rise) * np.sqrt(2 * abs(rise) / self.ratio))

    def _least_cost(self, value: float) -> float:
        """The cost with the parameter held, the others at their best."""
        bench, base = self.bench, self.base
        information, _ = normal_equations(bench, base)
        free = np.arange(len(base.values)) != self.index
        inverse = np.linalg.pinv(information[np.ix_(free, free)], hermitian=True)
        low, high = np.array([u.bounds for u in base.unknowns]).T
        x = base.values.copy()
        x[self.index] = value
        # On the ridge of the ellipse to begin with.
        x[free] -= inverse @ information[free, self.index] * (value - base.values[self.index])
        costs = []
        for step in range(_STEPS + 1):
            x = np.clip(x, low, high)
            [r] = bench.residuals([(*model_and_starts_at(base.model, base.starts, base.unknowns, x), None)])
            costs.append(cost_of(bench, base.unknowns, x, r))
            if step < _STEPS:
                _, pull = normal_equations_at(bench, base.unknowns, x, r, base.jacobian)
                x[free] -= inverse @ pull[free]
        return min(costs)
