"""What an unnamed fault of the link acts like: a function of one variable, and the place where it acts.

Residuals of strains and tip say that something is wrong with link or sensors. A force on the tip comes back through the
modes of the link, so that the residuals are no function of the variable on which the force depends. Here each pair of
place and variable is one hypothesis: a smooth function of the variable, a Gaussian process as in
`twin.diagnosis.unnamed`, acts as a force on the tip, as a change of stiffness or damping, or as an error of a reading.
The pairs are compared by their evidence.

They describe a fault that is already found. They are no test of whether there is one: sound rigs, too, leave residuals
of strains that are small smooth functions, by the error of the chain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from twin.diagnosis import dependence, remainder
from twin.diagnosis.linearised import Basis, hats, knots, samples_at, tried_functions
from twin.diagnosis.state import TIP, FunctionOf, SearchState, UnnamedFunction
from twin.estimation import output_error
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.mechanics import link_response
from twin.mechanics.chain import Chain
from twin.mechanics.state import Motion
from twin.recording import ON_LINK
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, low_passed
from twin.residuals.groups import Group
from twin.residuals.view import move_link

_STIFFNESS, _DAMPING = "bending_stiffness", "damping_ratio"


def find_functions(state: SearchState, rate: float) -> tuple[UnnamedFunction, ...]:
    """The functions that describe what sensors on the link leave unexplained, that with the largest evidence first.

    Args:
      state: the end of a search, with the Jacobian of its last fit.
      rate: false-alarm rate of the threshold `by_chance`.

    Returns:
      All functions that were tried; empty if the link is explained.
    """
    if not set(remainder.large_residuals(state)) & set(ON_LINK):
        return ()
    return functions_of(*output_error.on_driven_data(state.bench, state.best), rate)


def functions_of(bench: Workbench, best: Fit, rate: float) -> tuple[UnnamedFunction, ...]:
    """The functions behind the residuals of the link under a fit to driven data; otherwise as `find_functions`."""
    data = bench.data
    assert isinstance(data, DrivenData)
    on_link = [g for g in data.groups if g.channel in ON_LINK]
    variables = {i: dependence.variables_in(data, best, i) for i in {g.recording for g in on_link}}
    # The link may diverge on driven data, under a fit to other data.
    variables = {i: v for i, v in variables.items() if np.isfinite(list(v.values())).all()}
    groups = [g for g in on_link if g.recording in variables]
    if not groups:
        return ()
    return tried_functions(bench, best, _bases(bench, best, groups, variables), rate)


def _bases(
    bench: Workbench, best: Fit, groups: Sequence[Group], variables: Mapping[int, Mapping[str, np.ndarray]]
) -> Iterator[tuple[FunctionOf, Basis]]:
    """Each function that is tried, with its basis.

    Args:
      bench, best: the data and the fit.
      groups: rows of the sensors on the link.
      variables: recording that has these -> variable -> (m) its values.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    for name in sorted(set.intersection(*(set(v) for v in variables.values()))):
        values = {i: v[name] for i, v in variables.items()}
        seen = np.concatenate([values[g.recording][g.instants][bench.weight[g.rows] > 0] for g in groups])
        x = knots(seen)
        if x is None:
            continue
        samples = samples_at(seen, x)
        weights = {i: hats(v, x) for i, v in values.items()}
        for place in (TIP, _STIFFNESS, _DAMPING):
            moved = bench.pool.map(partial(_by_forces, data, best, place), weights, weights.values())
            changes = dict(zip(weights, moved, strict=True))
            parts = [changes[g.recording][g.channel] for g in groups]
            yield FunctionOf(name, place), Basis.of(bench, groups, parts, x, samples)
        for channel in sorted({g.channel for g in groups}):
            mine = [g for g in groups if g.channel == channel]
            parts = [_in_residual(data, best, g.recording, channel, weights[g.recording]) for g in mine]
            yield FunctionOf(name, channel), Basis.of(bench, mine, parts, x, samples)


def _by_forces(data: DrivenData, best: Fit, place: str, i: int, weights: np.ndarray) -> dict[str, np.ndarray]:
    """Channel on the link -> change (k x r) of its whitened residual in recording i.

    Args:
      data, best: the data and the fit.
      place: what changes: the force on the tip [N], or a parameter, relative to its value.
      i: of the recording.
      weights: (k x m) the changes.
    """
    chain, bends = best.model.chain, best.model.chain.modes("clamped")[1][1:]
    motion, _ = move_link(data.views[i], data.prepared[i], best.model, best.starts[i])
    forces = np.stack([weights * on_mode for on_mode in (_moments(chain, motion, place) @ bends).T])
    changes, bent = {}, link_response.modal_coordinates(chain, forces, GRID)
    for channel in data.views[i].measured.keys() & set(ON_LINK):
        if channel == "tip_acceleration":
            moved = link_response.modal_coordinates(chain, forces, GRID, accelerations=True)
            change = np.tensordot(chain.levers @ bends, moved, 1)
        else:
            change = np.tensordot(best.model.link_rows[channel] @ bends, bent, 1)
        changes[channel] = _in_residual(data, best, i, channel, change)
    return changes


def _moments(chain: Chain, motion: Motion, place: str) -> np.ndarray:
    """Moments on the hinges (m x n) by a unit change at a place along a motion (m), see `_by_forces` [N m]."""
    if place == TIP:
        return np.tile(chain.levers, (len(motion.time), 1))
    if place == _STIFFNESS:
        return -np.diff(motion.angles, axis=1) * chain.stiffness
    return -np.diff(motion.rates, axis=1) @ chain.damping


def _in_residual(data: DrivenData, best: Fit, i: int, channel: str, change: np.ndarray) -> np.ndarray:
    """Change (k x r) of a whitened residual in recording i by changes (k x m) of what a channel should read."""
    view = data.views[i]
    if data.prepared[i].hub is not None:  # with a free hub, readings pass the filter of the motion, too
        change = low_passed(change, GRID, view.band)
    return -residual.scaled_change(view, best.model, channel, low_passed(change, GRID))
