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

from twin.diagnosis import dependence, permutation, remainder
from twin.diagnosis.linearised import Basis, Linearised, hats, knots, samples_at
from twin.diagnosis.state import TIP, FunctionOf, SearchState, UnnamedFunction
from twin.estimation import output_error
from twin.estimation.fit import Fit
from twin.estimation.workbench import Workbench
from twin.mechanics import link_response
from twin.recording import ON_LINK
from twin.residuals import residual
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID, low_passed
from twin.residuals.groups import Group
from twin.residuals.view import move_link

_STIFFNESS, _DAMPING = "bending_stiffness", "damping_ratio"
_Variables = Mapping[int, Mapping[str, np.ndarray]]
"""Recording -> variable -> (m) its values."""


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
    groups = [g for g in data.groups if g.channel in ON_LINK]
    variables = {i: dependence.variables_in(data, best, i) for i in {g.recording for g in groups}}
    signs = permutation.random_signs(bench, permutation.DRAWS, np.random.default_rng(permutation.SEED))
    linearised = Linearised.of(bench, best)
    tried = [(law, b, linearised.evidence(b, signs)) for law, b in _bases(bench, best, groups, variables)]
    largest = np.max([e.by_draw for _, _, (e, _) in tried], axis=0, initial=0.0)
    by_chance = permutation.threshold(np.sort(largest), rate)
    functions = [UnnamedFunction(law, e.value, by_chance, b.x, y, b.samples) for law, b, (e, y) in tried]
    return tuple(sorted(functions, key=lambda n: -n.evidence))


def _bases(
    bench: Workbench, best: Fit, groups: Sequence[Group], variables: _Variables
) -> Iterator[tuple[FunctionOf, Basis]]:
    """Each function that is tried, with its basis.

    Args:
      bench, best: the data and the fit.
      groups: rows of the sensors on the link.
      variables: of the recordings that have these.
    """
    data = bench.data
    assert isinstance(data, DrivenData)
    for name in sorted(set.intersection(*(set(v) for v in variables.values()))):
        values = {i: v[name] for i, v in variables.items()}
        x = knots(_seen(bench, groups, values))
        if x is None:
            continue
        samples = samples_at(_seen(bench, groups, values), x)
        weights = {i: hats(v, x) for i, v in values.items()}
        for place in (TIP, _STIFFNESS, _DAMPING):
            moved = bench.pool.map(partial(_by_forces, data, best, place), weights, weights.values())
            changes = dict(zip(weights, moved, strict=True))
            parts = [changes[g.recording][g.channel] for g in groups]
            yield FunctionOf(name, place), _basis(bench, groups, parts, x, samples)
        for channel in sorted({g.channel for g in groups}):
            mine = [g for g in groups if g.channel == channel]
            parts = [_in_residual(data, g.recording, channel, weights[g.recording]) for g in mine]
            yield FunctionOf(name, channel), _basis(bench, mine, parts, x, samples)


def _seen(bench: Workbench, groups: Sequence[Group], values: Mapping[int, np.ndarray]) -> np.ndarray:
    """Values (r) of a variable where a sensor on the link is compared; `values`: recording -> (m)."""
    return np.concatenate([values[g.recording][bench.weight[g.rows] > 0] for g in groups])


def _basis(
    bench: Workbench, groups: Sequence[Group], parts: Sequence[np.ndarray], x: np.ndarray, samples: np.ndarray
) -> Basis:
    """The basis of a function.

    Args:
      bench: the data.
      groups: the rows that it changes, ascending.
      parts: of each group, the derivative (k x m) of its residual by the value at each knot.
      x, samples: (k) the knots, and the number of samples nearest to each.
    """
    columns = [bench.weight[g.rows, None] * part.T for g, part in zip(groups, parts, strict=True)]
    rows = np.concatenate([np.arange(g.rows.start, g.rows.stop) for g in groups])
    return Basis(x, np.concatenate(columns), rows, samples)


def _by_forces(data: DrivenData, best: Fit, place: str, i: int, weights: np.ndarray) -> dict[str, np.ndarray]:
    """Channel on the link -> change (k x m) of its whitened residual in recording i.

    Args:
      data, best: the data and the fit.
      place: what changes: the force on the tip [N], or a parameter, relative to its value.
      i: of the recording.
      weights: (k x m) the changes.
    """
    model = best.model
    chain, bends = model.chain, model.chain.modes("clamped")[1][1:]
    motion, _ = move_link(data.views[i], data.prepared[i], model, best.starts[i])
    match place:
        case "tip_force":
            moments = np.broadcast_to(link_response.levers(chain), (len(motion.time), len(bends)))
        case "bending_stiffness":
            moments = -np.diff(motion.angles, axis=1) * chain.stiffness
        case _:
            moments = -np.diff(motion.rates, axis=1) @ chain.damping
    forces = np.stack([weights * on_mode for on_mode in (moments @ bends).T])
    changes, bent = {}, link_response.modal_coordinates(chain, forces, GRID)
    for channel in data.views[i].measured.keys() & set(ON_LINK):
        if channel == "tip_acceleration":
            accelerations = link_response.modal_coordinates(chain, forces, GRID, accelerations=True)
            change = np.tensordot(link_response.levers(chain) @ bends, accelerations, 1)
        elif channel == "tip_deflection":
            change = np.tensordot(link_response.levers(chain) @ bends, bent, 1)
        else:
            row = model.sensors[channel].half_thickness * model.curvature_rows[channel]
            change = np.tensordot(row @ bends, bent, 1)
        changes[channel] = _in_residual(data, i, channel, change)
    return changes


def _in_residual(data: DrivenData, i: int, channel: str, change: np.ndarray) -> np.ndarray:
    """Change (k x m) of a whitened residual in recording i by changes (k x m) of what a channel should read."""
    view = data.views[i]
    if data.prepared[i].hub is not None:  # with a free hub, readings pass the filter of the motion, too
        change = low_passed(change, GRID, view.band)
    return -residual.normalise(view.known[channel] * low_passed(change, GRID), view, channel)
