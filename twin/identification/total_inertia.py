"""The total inertia by the angular momentum of the whole rig, whose change is the impulse of drive and friction.

Integrated once more, so that nothing measured is differentiated,

    J theta + sum_k K_k w''(x_k) + int N dt = iint (tau - f) dt dt + a + b t

with a and b of each run in which the hub slides. The link moves in as many shapes as there are gauges, at x_k: what
the drive bends it to, and its first free mode. The second one is averaged out by a window whose spectrum is zero there.
N is what a link that bends far lacks of momentum: it is foreshortened, its mass is nearer to the hub's axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_simpson, simpson
from scipy.ndimage import binary_dilation, label

from twin.effects import REGISTRY
from twin.identification.balance import by_laws, clustered, gauges, shares
from twin.identification.estimates import EXPLAINED, Estimate, grown, student
from twin.mechanics import beam
from twin.residuals import resample
from twin.residuals.cell_means import double_mean_torque
from twin.residuals.data import DrivenData
from twin.residuals.filters import BAND, REACH
from twin.residuals.prepared import Prepared
from twin.residuals.view import View, hub_trajectory
from twin.rigs.model import Model

_SHAPES = 2  # gauges that tell what the drive bends the link to from its first free mode
_MORE = 2  # runs beyond the number of unknowns: Student's interval of fewer says nothing
_ROWS = 41  # instants along the link at which its shape is known


@dataclass(frozen=True)
class Momentum:
    """The balance of the whole rig's angular momentum.

    Attributes:
      inertia: J [kg m^2], with an interval of Student's distribution: each run is one piece of evidence.
      determination: share of the hub angle's variance that the balance explains, a line in each run left out [1].
    """

    inertia: Estimate
    determination: float

    @property
    def believed(self) -> bool:
        """Whether it explains enough for its number to be an estimate."""
        return self.determination >= EXPLAINED


def of_rig(data: DrivenData, model: Model) -> Momentum | None:
    """The balance over all recordings with a free hub and two gauges; None where they say too little.

    None, too, where effects are known that come between motor and hub, or between motion and readings.

    The hub's angle is what is regressed, since its noise is white: J is one over the factor of drive's impulse.

    Args:
      data: recordings, and where in them the hub slides.
      model: its sensors and torque limit count, and its rig for the length of the window and for the momentum that a
        bent link lacks, some parts in a thousand.
    """
    if model.plant.motor.gap > 0 or any(REGISTRY[name].misreads for name in model.effects):
        return None
    pairs = zip(data.prepared, data.views, strict=True)
    runs = [run for p, v in pairs if _usable(p, model) for run in _runs(p, v, model)]
    unknowns = _SHAPES + 3
    if len(runs) < unknowns + _MORE:
        return None
    rows = np.vstack(runs)
    y, X = rows[:, 0], rows[:, 1:]
    size = np.sqrt((X**2).mean(axis=0))
    if not size.all() or np.linalg.cond(X / size) > 1e4:
        return None
    x, covariance = clustered(X / size, y, np.repeat(np.arange(len(runs)), [len(r) for r in runs]))
    if x[0] <= 0:
        return None
    inertia = float(size[0] / x[0])
    left = y - X / size @ x
    return Momentum(
        student(inertia, inertia * math.sqrt(covariance[0, 0]) / float(x[0]), len(runs) - unknowns),
        1 - float(left @ left) / float(y @ y),
    )


def with_error_of(found: Momentum, other: Momentum) -> Momentum:
    """The balance, its error grown by that of something else that it takes as known.

    Args:
      found: the balance.
      other: the same with that one standard error larger.
    """
    return replace(found, inertia=grown(found.inertia, other.inertia))


def lacking(
    bends: Sequence[np.ndarray],
    positions: Sequence[float],
    time: np.ndarray,
    rate: np.ndarray,
    rig: Mapping[str, float],
) -> np.ndarray:
    """Angular momentum (m) of an inextensible link bent as its gauges show, less that of small bends [N m s].

    N = sum of dm (theta_t (x^2 + y^2 - s^2) + x y_t - y x_t - s z_t) over link and payload, in the hub's axes, with
    x_s = cos psi, y_s = sin psi, z_s = psi and psi_s the polynomial through the curvatures at the gauges and
    none at the tip, as of a load there.

    Args:
      bends: (k) curvatures (m) at the gauges [1/m].
      positions: (k) of the gauges [m].
      time: (m) uniform [s].
      rate: (m) of the hub [rad/s].
      rig: `length`, `linear_density` and `tip_mass`.
    """
    s = np.linspace(0.0, rig["length"], _ROWS)
    curvature = np.array(bends).T @ _through(s, positions)
    psi = _along(curvature, s)
    x, y, z = _along(np.cos(psi), s), _along(np.sin(psi), s), _along(psi, s)
    x_t, y_t, z_t = (np.gradient(v, time, axis=0) for v in (x, y, z))
    share = rate[:, None] * (x**2 + y**2 - s**2) + x * y_t - y * x_t - s * z_t
    return rig["linear_density"] * simpson(share, x=s) + rig["tip_mass"] * share[:, -1]


def _along(values: np.ndarray, s: np.ndarray) -> np.ndarray:
    return cumulative_simpson(values, x=s, initial=0.0)


def _through(s: np.ndarray, positions: Sequence[float]) -> np.ndarray:
    """Polynomials (k x rows) that are one at a gauge, zero at the others and at the link's end (J. L. Lagrange)."""
    zeros = [np.array([*(o for o in positions if o != x), s[-1]]) for x in positions]
    return np.array(
        [np.prod((s[:, None] - z) / (x - z), axis=1) for x, z in zip(positions, zeros, strict=True)]
    )


def _usable(prepared: Prepared, model: Model) -> bool:
    return prepared.hub is not None and len(gauges(prepared, model)) == _SHAPES


def _runs(prepared: Prepared, view: View, model: Model) -> list[np.ndarray]:
    """Runs of a recording, of (n x 6) each: hub angle, impulse's integral, two curvatures, friction's by direction."""
    window = _window(model, float(view.time[1] - view.time[0]))
    signals = _signals(prepared, view, model)
    runs, count = label(_sliding(view) & _read(view, gauges(prepared, model)))
    found = [signals[runs == k] for k in range(1, count + 1)]
    return [_without_line(_averaged(run, window)) for run in found if len(run) > 2 * len(window)]


def _signals(prepared: Prepared, view: View, model: Model) -> np.ndarray:
    """What is balanced (m x 6), up to factors that are asked for."""
    t, names = view.time, gauges(prepared, model)
    half = [model.sensors[g].half_thickness for g in names]
    positions = [model.sensors[g].position for g in names]
    filtered = [view.measured[g] / h for g, h in zip(names, half, strict=True)]
    bends = [
        resample.resample_channel(prepared.recording, g, t)[0] / h for g, h in zip(names, half, strict=True)
    ]
    drive = double_mean_torque(model, prepared.recording, t) + by_laws(model, t, hub_trajectory(view, model))
    impulse = _integral(drive, t)
    impulse -= lacking(filtered, positions, t, view.rate, model.declared)
    friction = [_integral(_integral(share, t), t) for share in shares(view)]
    return np.column_stack([view.reading, _integral(impulse, t), *bends, *friction])


def _integral(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return float(time[1] - time[0]) * (np.cumsum(values) - (values + values[0]) / 2)


def _sliding(view: View) -> np.ndarray:
    """Where (m) the hub surely slides: its angle has passed a wider filter, of shorter reach, than its torque."""
    spared = int(REACH * (1 - BAND / view.band) / (view.time[1] - view.time[0]))
    return binary_dilation(view.sliding, iterations=spared) if spared > 0 else view.sliding


def _read(view: View, names: Sequence[str]) -> np.ndarray:
    """Where (m) all these gauges were read, with the reach of the filter on what bridges a gap."""
    missing = np.any([~view.known[name] for name in names], axis=0)
    return ~binary_dilation(missing, iterations=round(REACH / (view.time[1] - view.time[0])))


def _window(model: Model, period: float) -> np.ndarray:
    """Weights of a mean (J. von Hann) whose spectrum has its first zero at the second free mode."""
    second = float(beam.modes(model.declared, 2).frequencies[1]) / (2 * math.pi)
    count = max(1, round(2 / second / period))
    weights = np.sin(math.pi * (np.arange(count) + 0.5) / count) ** 2
    return weights / weights.sum()


def _averaged(run: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Moving means of the columns of a run, within it."""
    return np.column_stack([np.convolve(column, window, "valid") for column in run.T])


def _without_line(run: np.ndarray) -> np.ndarray:
    """A run less a line in each column: angle and rate before it are not known."""
    line = np.vander(np.linspace(-1.0, 1.0, len(run)), 2)
    return run - line @ np.linalg.lstsq(line, run, rcond=None)[0]
