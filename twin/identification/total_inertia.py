"""Total inertia by the balance of the rig's angular momentum, whose change is the impulse of drive and friction.

Integrated once more, so that no measurement has to be differentiated,

    J theta + sum_k K_k w''(x_k) + int N dt = iint (tau - f) dt dt + a + b t

with constants a and b for each run in which the hub slides without a stop. The link is described by as many shapes as
there are gauges, at x_k: the quasi-static one under the drive's torque, and its first free mode. The second mode is
suppressed by a moving average whose frequency response has a zero there. N is the difference in angular momentum
between the bent link and its linearisation: a bent link is foreshortened, its mass is nearer to the hub's axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_simpson, simpson
from scipy.ndimage import binary_dilation, label

from twin.effects import REGISTRY
from twin.identification.balance import (
    available_gauges,
    clustered_least_squares,
    direction_shares,
    effect_torque,
)
from twin.identification.estimates import MIN_DETERMINATION, Estimate, student_t_estimate, with_nuisance_error
from twin.mechanics import beam
from twin.residuals import resample
from twin.residuals.cell_means import double_mean_torque
from twin.residuals.data import DrivenData
from twin.residuals.filters import BAND, REACH
from twin.residuals.prepared import Prepared
from twin.residuals.view import View, hub_trajectory
from twin.rigs.model import Model

_GAUGES_NEEDED = 2  # one for the quasi-static shape and one for the first free mode
_MIN_DEGREES_OF_FREEDOM = 2  # runs less unknowns: with fewer, Student's t interval is too wide to be of use
_LINK_POINTS = 41  # points along the link at which its shape is computed


@dataclass(frozen=True)
class MomentumBalance:
    """Balance of the angular momentum of the whole rig by linear regression.

    Attributes:
      inertia: J [kg m^2], with Student's t interval: residuals are clustered by run.
      determination: R^2 of the hub angle, without the line of each run [1].
    """

    inertia: Estimate
    determination: float

    @property
    def accepted(self) -> bool:
        """Whether R^2 is high enough to use the inertia."""
        return self.determination >= MIN_DETERMINATION


def momentum_balance(data: DrivenData, model: Model) -> MomentumBalance | None:
    """Returns the balance over all recordings with a free hub and two gauges.

    None where the recordings do not determine it, or where a backlash or an effect on the sensors is declared. The hub
    angle is the dependent variable, since its noise is white: J is the inverse of the coefficient of the impulse.

    Args:
      data: recordings, and where in them the hub slides.
      model: its sensors, effects and torque limit are used; its rig for the averaging window and for N, a correction of
        some parts in a thousand.
    """
    if model.plant.motor.gap > 0 or any(REGISTRY[name].acts_on_readings for name in model.effects):
        return None
    pairs = zip(data.prepared, data.views, strict=True)
    runs = [run for p, v in pairs if _usable(p, model) for run in _runs(p, v, model)]
    unknowns = _GAUGES_NEEDED + 3
    if len(runs) < unknowns + _MIN_DEGREES_OF_FREEDOM:
        return None
    rows = np.vstack(runs)
    y, X = rows[:, 0], rows[:, 1:]
    size = np.sqrt((X**2).mean(axis=0))
    if not size.all() or np.linalg.cond(X / size) > 1e4:
        return None
    x, covariance = clustered_least_squares(
        X / size, y, np.repeat(np.arange(len(runs)), [len(r) for r in runs])
    )
    if x[0] <= 0:
        return None
    inertia = float(size[0] / x[0])
    residual = y - X / size @ x
    return MomentumBalance(
        student_t_estimate(
            inertia, inertia * math.sqrt(covariance[0, 0]) / float(x[0]), len(runs) - unknowns
        ),
        1 - float(residual @ residual) / float(y @ y),
    )


def with_momentum_nuisance_error(balance: MomentumBalance, perturbed: MomentumBalance) -> MomentumBalance:
    """Returns the balance, its error increased by that of a nuisance parameter.

    Args:
      balance: with the nuisance parameter at its estimate.
      perturbed: with the nuisance parameter one standard error larger.
    """
    return replace(balance, inertia=with_nuisance_error(balance.inertia, perturbed.inertia))


def foreshortening_momentum(
    bends: Sequence[np.ndarray],
    positions: Sequence[float],
    time: np.ndarray,
    rate: np.ndarray,
    rig: Mapping[str, float],
) -> np.ndarray:
    """Angular momentum (m) of the bent inextensible link less that of its linearisation, N [N m s].
    N = sum of dm (theta_t (x^2 + y^2 - s^2) + x y_t - y x_t - s z_t) over link and payload, in the hub's axes, with
    x_s = cos psi, y_s = sin psi, z_s = psi, and psi_s the polynomial through the curvatures at the gauges and zero at
    the tip, as under a load there.

    Args:
      bends: (k) curvatures (m) at the gauges [1/m].
      positions: (k) of the gauges [m].
      time: (m) uniform [s].
      rate: (m) of the hub [rad/s].
      rig: `length`, `linear_density` and `tip_mass`.
    """
    s = np.linspace(0.0, rig["length"], _LINK_POINTS)
    curvature = np.array(bends).T @ _lagrange_polynomials(s, positions)
    psi = _integral_along_link(curvature, s)
    x, y, z = (
        _integral_along_link(np.cos(psi), s),
        _integral_along_link(np.sin(psi), s),
        _integral_along_link(psi, s),
    )
    x_t, y_t, z_t = (np.gradient(v, time, axis=0) for v in (x, y, z))
    share = rate[:, None] * (x**2 + y**2 - s**2) + x * y_t - y * x_t - s * z_t
    return rig["linear_density"] * simpson(share, x=s) + rig["tip_mass"] * share[:, -1]


def _integral_along_link(values: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Integral of (m x rows) values along the link, from 0 to each point s (rows) [m]."""
    return cumulative_simpson(values, x=s, initial=0.0)


def _lagrange_polynomials(s: np.ndarray, positions: Sequence[float]) -> np.ndarray:
    """Lagrange polynomials (k x rows): one at a gauge, zero at the others and at the end of the link."""
    zeros = [np.array([*(o for o in positions if o != x), s[-1]]) for x in positions]
    return np.array(
        [np.prod((s[:, None] - z) / (x - z), axis=1) for x, z in zip(positions, zeros, strict=True)]
    )


def _usable(prepared: Prepared, model: Model) -> bool:
    return prepared.hub is not None and len(available_gauges(prepared, model)) == _GAUGES_NEEDED


def _runs(prepared: Prepared, view: View, model: Model) -> list[np.ndarray]:
    """Runs of uninterrupted sliding in a recording, as columns of the regression (n x 6) each, see `_signals`."""
    window = _window(model, float(view.time[1] - view.time[0]))
    signals = _signals(prepared, view, model)
    runs, count = label(_sliding(view) & _gauges_valid(view, available_gauges(prepared, model)))
    segments = [signals[runs == k] for k in range(1, count + 1)]
    return [_detrended(_moving_average(run, window)) for run in segments if len(run) > 2 * len(window)]


def _signals(prepared: Prepared, view: View, model: Model) -> np.ndarray:
    """Columns (m x 6): hub angle, integral of impulse less N, two curvatures, double integral of friction forwards and
    backwards."""
    t, names = view.time, available_gauges(prepared, model)
    half = [model.sensors[g].half_thickness for g in names]
    positions = [model.sensors[g].position for g in names]
    filtered = [view.measured[g] / h for g, h in zip(names, half, strict=True)]
    bends = [
        resample.resample_channel(prepared.recording, g, t)[0] / h for g, h in zip(names, half, strict=True)
    ]
    drive = double_mean_torque(model.drive(prepared.recording), t) + effect_torque(
        model, t, hub_trajectory(view, model)
    )
    impulse = _integral(drive, t)
    impulse -= foreshortening_momentum(filtered, positions, t, view.rate, model.declared)
    friction = [_integral(_integral(share, t), t) for share in direction_shares(view)]
    return np.column_stack([view.reading, _integral(impulse, t), *bends, *friction])


def _integral(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Integral (m) from the first instant by the trapezoidal rule."""
    return float(time[1] - time[0]) * (np.cumsum(values) - (values + values[0]) / 2)


def _sliding(view: View) -> np.ndarray:
    """Where (m) the hub slides; the margin to rests is that of the angle's low-pass, shorter than the torque's."""
    difference = int(REACH * (1 - BAND / view.band) / (view.time[1] - view.time[0]))
    return binary_dilation(view.sliding, iterations=difference) if difference > 0 else view.sliding


def _gauges_valid(view: View, names: Sequence[str]) -> np.ndarray:
    """Where (m) all these gauges have readings, with the reach of the low-pass as margin to every gap."""
    missing = np.any([~view.known[name] for name in names], axis=0)
    return ~binary_dilation(missing, iterations=round(REACH / (view.time[1] - view.time[0])))


def _window(model: Model, period: float) -> np.ndarray:
    """Hann window of a moving average whose frequency response has its first zero at the second free mode."""
    second = float(beam.modes(model.declared, 2).frequencies[1]) / (2 * math.pi)
    count = max(1, round(2 / second / period))
    weights = np.sin(math.pi * (np.arange(count) + 0.5) / count) ** 2
    return weights / weights.sum()


def _moving_average(run: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Moving averages of the columns of a run, without its ends."""
    return np.column_stack([np.convolve(column, window, "valid") for column in run.T])


def _detrended(run: np.ndarray) -> np.ndarray:
    """A run less a fitted line in each column: the constants a and b."""
    line = np.vander(np.linspace(-1.0, 1.0, len(run)), 2)
    return run - line @ np.linalg.lstsq(line, run, rcond=None)[0]
