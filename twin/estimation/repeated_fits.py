"""Errors of a fit with a play by repeated fits, where those of a linearised model are far too small.

Each impact of a play changes the next one. So the cost is rough over many standard errors, a fit ends in one of many
minima beside each other, and its curvature there does not tell how far away the others are. And the motion that drives
the link is smoothed, an impact with it, so that the estimate has a bias. Both are found by fits: from displaced starts,
and to simulations of the fit (parametric bootstrap: B. Efron, Annals of Statistics 7, 1979).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.minimise import minimise
from twin.estimation.unknowns import model_and_starts_at
from twin.estimation.workbench import Workbench, driven_data
from twin.mechanics.state import Start
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared, prepare
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

_Given = tuple[Prepared, Model, Start, np.random.Generator, int]


def likeliest_with_scatter(bench: Workbench, base: Fit) -> tuple[Fit, np.ndarray]:
    """The likeliest of a fit and those from displaced starts, and their mean square distance from it (p x p).

    Without a play, the fit and zero.
    """
    if not is_repeated(bench, base):
        return base, np.zeros((len(base.unknowns), len(base.unknowns)))
    ends = [base, *from_displaced_starts(bench, base)]
    best = min(ends, key=lambda fit: fit.cost)
    return best, _mean_square([fit.values - best.values for fit in ends])


def without_bias(bench: Workbench, base: Fit) -> Fit:
    """The fit with its values less the bias that fits to its own simulations show, which counts as error, too.

    Its residual stays that of the fit.
    """
    shifts = [fit.values - base.values for fit in to_own_simulations(bench, base)]
    low, high = np.array([u.bounds for u in base.unknowns]).T
    values = np.clip(base.values - np.mean(shifts, axis=0), low, high)
    model, starts = model_and_starts_at(base.model, base.starts, base.unknowns, values)
    covariance = base.covariance + _mean_square(shifts)
    return replace(base, model=model, starts=starts, values=values, covariance=covariance)


def is_repeated(bench: Workbench, base: Fit) -> bool:
    """Whether a fit is one to repeat: of a play, to driven data. To output errors, each would take minutes."""
    return bool(_of_play(base)) and isinstance(bench.data, DrivenData)


def _of_play(base: Fit) -> list[int]:
    return [k for k, u in enumerate(base.unknowns) if u.effect and not REGISTRY[u.effect].linearisable]


def from_displaced_starts(bench: Workbench, base: Fit) -> list[Fit]:
    """Fits begun beside this one: each parameter of the play in turn, either way, as far as data visibly change."""
    moves = [(k, side) for k in _of_play(base) for side in (1, -1)]
    starts = np.repeat(base.values[None], len(moves), axis=0)
    for row, (k, side) in enumerate(moves):
        starts[row, k] += side * base.unknowns[k].scale
    return [_fitted(bench, base, values) for values in starts]


def to_own_simulations(bench: Workbench, base: Fit) -> list[Fit]:
    """Fits to two simulations of a fit, from its own parameters.

    The noise of the second is the opposite of that of the first: whatever is in proportion to it cancels in the mean of
    their errors, and the bias remains.
    """
    return [_fitted(_simulated(bench, base, sign), base, base.values) for sign in (1, -1)]


def _fitted(bench: Workbench, base: Fit, values: np.ndarray) -> Fit:
    return minimise(bench, base.model, base.starts, base.unknowns, values)


def _mean_square(distances: Sequence[np.ndarray]) -> np.ndarray:
    """Mean outer product (p x p) of distances (p)."""
    away = np.array(distances)
    return away.T @ away / len(away)


def _simulated(bench: Workbench, base: Fit, sign: int) -> Workbench:
    """Simulations of a fit in place of the recordings, with noise of this sign."""
    given = [
        (prepared, base.model, start, np.random.default_rng(i), sign)
        for i, (prepared, start) in enumerate(zip(bench.prepared, base.starts, strict=True))
    ]
    runs = list(bench.pool.map(_simulation, given))
    simulated = Workbench(driven_data(runs, base.model, bench.pool), bench.pool)
    return simulated.without_channels(simulated.channels() - bench.channels())


def _simulation(given: _Given) -> Prepared:
    """A recording with a free run and noise in place of its readings; missing ones stay missing."""
    prepared, model, start, rng, sign = given
    recording = prepared.recording
    run, channels = simulate(model, recording, start), dict(recording.channels)
    for name in prepared.channels:
        noise = sign * prepared.noise[name] * rng.standard_normal(len(recording.time))
        known = np.isfinite(recording[name]) & np.isfinite(run[name])
        channels[name] = np.where(known, run[name] + noise, np.nan)
    again, _ = prepare(recording.replace(channels=channels), prepared.noise)
    return replace(again, off_zero=prepared.off_zero)
