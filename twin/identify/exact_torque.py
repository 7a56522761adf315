"""The hub's torque balance without the second-order errors of its grid.

A search follows the hub by a cubic spline, whose second derivative is too large by (omega h)^2/12, and compares the
torque at an instant with one that is averaged over a step, too small by (omega h)^2/24. At 18 Hz and h = 2 ms that
makes inertias 0.4 % too small: nothing to a search for effects, much to an identification. Both are put right here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from twin import driven, planar
from twin.driven import DrivenData, View
from twin.fit import Prepared
from twin.model import Model, Motion, Start

_CELLS = 9  # parts of a grid step, an odd number


class ExactTorqueData(DrivenData):
    """The views of some recordings as residuals for a fit."""

    def __init__(
        self, prepared: Sequence[Prepared], model: Model, bands: Sequence[float] = driven.MOTION_BANDS
    ):
        super().__init__(prepared, model, bands)
        self.views = tuple(_alike_filtered(v) for v in self.views)
        self.excess = tuple(_excess(p, v) for p, v in zip(self.prepared, self.views, strict=True))

    def residual(self, model: Model, i: int, start: Start) -> dict[str, np.ndarray]:
        """Channel -> residual (m) of recording i in noise units, as `driven.residual` with the torque put right."""
        parts = super().residual(model, i, start)
        excess, view = self.excess[i], self.views[i]
        if excess is not None and "hub_torque" in parts:
            motion, required = driven.move(view, self.prepared[i], model, start)
            exact = twice_averaged(required - free_hub_inertia(model) * excess)
            exact = exact + (1 - one_way(view)) * _friction(model, view, motion)
            # The measured motion has passed one low-pass more than the torque.
            torque = driven.low_passed(
                mean_torque(self.prepared[i], view.time, model), driven.GRID, view.band
            )
            change = exact - required + _held(self.prepared[i], view.time, model) - torque
            change = driven.low_passed(change, driven.GRID) / view.noise["hub_torque"]
            parts["hub_torque"] = parts["hub_torque"] + np.where(view.sliding, change, 0.0)
        return parts


def _alike_filtered(view: View) -> View:
    """The view, its strains behind the low-pass that the motion of the hub has passed."""
    passed = {c: driven.low_passed(v, driven.GRID, view.band) for c, v in view.measured.items()}
    return replace(view, measured=passed)


def mean_torque(prepared: Prepared, time: np.ndarray, model: Model) -> np.ndarray:
    """Torque (m) of the drive about each instant of a grid, averaged over a step twice [N m].

    A command that is held makes a staircase. Its mean over one step still sees the stairs (by (omega h)^2/24), the
    mean of that mean no longer.
    """
    step = float(time[1] - time[0])
    cell = step / _CELLS
    cells = np.arange(-_CELLS, (len(time) + 1) * _CELLS + 1)
    impulse = model.drive(prepared.recording).impulse(time[0] + (cells - 0.5) * cell)
    mean = np.diff(impulse) / cell
    window = np.convolve(np.ones(_CELLS), np.ones(_CELLS)) / _CELLS**2
    return np.convolve(mean, window, "same")[_CELLS::_CELLS][: len(time)]


def _held(prepared: Prepared, time: np.ndarray, model: Model) -> np.ndarray:
    """Mean torque (m) of the drive over a grid step about each instant [N m], as a search compares it."""
    edges = np.r_[time - driven.GRID / 2, time[-1] + driven.GRID / 2]
    return np.diff(model.drive(prepared.recording).impulse(edges)) / driven.GRID


def one_way(view: View) -> np.ndarray:
    """Mean of the hub's direction over a grid step about each instant (m), over the direction there: 1 but where the
    hub turns round."""
    step = np.abs(view.acceleration) * driven.GRID / 2
    return np.clip(np.abs(view.rate) / np.maximum(step, 1e-12), 0.0, 1.0)


def _friction(model: Model, view: View, motion: Motion) -> np.ndarray:
    """Torque (m) of the sliding friction [N m]."""
    state = view.time, motion.angles[:, 0], motion.rates[:, 0]
    resting = planar.hub_laws(model.plant, *state, np.zeros(len(view.time)))
    return planar.hub_laws(model.plant, *state, motion.modes) - resting


def _excess(prepared: Prepared, view: View) -> np.ndarray | None:
    """By how much (m) the cubic spline's acceleration is too large [rad/s^2], as a septic one tells."""
    if prepared.hub is None:
        return None
    return view.acceleration - make_interp_spline(view.time, view.reading, k=7)(view.time, 2)


def twice_averaged(values: np.ndarray) -> np.ndarray:
    """Means over a grid step of means over a grid step (m) of a smooth signal: x + h^2 x''/12; the ends as they are."""
    means = values.copy()
    means[1:-1] += (values[:-2] - 2 * values[1:-1] + values[2:]) / 12
    return means


def free_hub_inertia(model: Model) -> float:
    """Torque at once per acceleration of the hub, the link's hinges free [kg m^2]: hardly more than J0."""
    M = model.chain.mass_matrix()
    return float(M[0, 0] - M[0, 1:] @ np.linalg.solve(M[1:, 1:], M[1:, 0]))
