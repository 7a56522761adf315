"""The hub's torque balance without the second-order errors of its grid.

A search follows the hub by a cubic spline, whose second derivative is too large by (omega h)^2/12, and compares the
torque at an instant with one that is averaged over a step, too small by (omega h)^2/24. At 18 Hz and h = 2 ms that
makes inertias 0.4 % too small: nothing to a search for effects, much to an identification. Both are put right here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from twin import driven
from twin.driven import DrivenData, View
from twin.fit import Prepared
from twin.model import Model, Start


class ExactTorqueData(DrivenData):
    """The views of some recordings as residuals for a fit."""

    def __init__(self, prepared: Sequence[Prepared], model: Model):
        super().__init__(prepared, model)
        self.excess = tuple(_excess(p, v) for p, v in zip(self.prepared, self.views, strict=True))

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> residual (m) of recording i in noise units, as `driven.residual` with the torque put right."""
        parts = super().residual(model, i, start)
        excess, view = self.excess[i], self.views[i]
        if excess is not None and "hub_torque" in parts:
            _, required = driven.move(view, self.prepared[i], model, start)
            right = averaged(required - free_hub_inertia(model) * excess)
            change = driven.low_passed(right - required, driven.GRID) / view.noise["hub_torque"]
            parts["hub_torque"] = parts["hub_torque"] + np.where(view.sliding, change, 0.0)
        return parts


def _excess(prepared: Prepared, view: View) -> np.ndarray | None:
    """By how much (m) the cubic spline's acceleration is too large [rad/s^2], as a septic one tells."""
    if prepared.hub is None:
        return None
    return view.acceleration - make_interp_spline(view.time, view.reading, k=7)(view.time, 2)


def averaged(values: np.ndarray) -> np.ndarray:
    """Means over a grid step about each sample (m) of a smooth signal: x + h^2 x''/24; the ends as they are."""
    means = values.copy()
    means[1:-1] += (values[:-2] - 2 * values[1:-1] + values[2:]) / 24
    return means


def free_hub_inertia(model: Model) -> float:
    """Torque at once per acceleration of the hub, the link's hinges free [kg m^2]: hardly more than J0."""
    M = model.chain.mass_matrix()
    return float(M[0, 0] - M[0, 1:] @ np.linalg.solve(M[1:, 1:], M[1:, 0]))
