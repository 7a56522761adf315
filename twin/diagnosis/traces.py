"""Residuals over time and over the variable that explains them, for the plots of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.diagnosis.answer import Trace
from twin.diagnosis.dependence import TRAVEL, Unexplained, travel, unexplained_residuals, variance_shares
from twin.diagnosis.state import SearchState
from twin.mechanics.state import Start
from twin.recording import HUB_TORQUE
from twin.residuals.data import DrivenData
from twin.residuals.prepared import Prepared
from twin.residuals.residual import raw_residual
from twin.rigs.model import Model, with_fine_chain

FEWEST = 12
"""Samples from which the residuals of a channel are plotted or judged: a tenth of a second."""
_SHOWN = (HUB_TORQUE, "strain_base", "strain_mid", "tip_deflection", "tip_acceleration")
_EXPLAINED = 0.1  # share of the variance from which a variable is named


def explained_traces(state: SearchState, residuals: Mapping[str, Unexplained]) -> tuple[Trace, ...]:
    """Residuals of the calibrated model without adopted effects, the channels that the effects improve most first.

    Args:
      state: the end of the search.
      residuals: channel -> residuals of the final model.
    """
    traces = []
    before = unexplained_residuals(state.bench, state.base) if state.adopted else residuals
    for channel in _SHOWN:
        if channel not in before or len(before[channel].values) < FEWEST:
            continue
        left, after = before[channel], residuals[channel]
        gained = float(np.log(np.std(left.values) / max(np.std(after.values), 1e-30)))
        shares = variance_shares(left)
        explained = shares[0][0] if shares and shares[0][1] > _EXPLAINED else None
        trace = _trace(channel, left, explained)
        fitted = left.values - after.values if state.adopted else None
        traces.append((gained, replace(trace, fitted=fitted)))
    return tuple(trace for _, trace in sorted(traces, key=lambda pair: -pair[0]))


def final_traces(
    residuals: Mapping[str, Unexplained], worst: Sequence[str], depends: Sequence[str]
) -> tuple[Trace, ...]:
    """Residuals of the final model.

    Args:
      residuals: channel -> its residuals.
      worst: channels that are not explained; they come first.
      depends: variables on which the residuals of these depend, the strongest first.
    """
    channels = [c for c in dict.fromkeys((*worst, *_SHOWN)) if c in residuals]
    return tuple(
        _trace(c, residuals[c], depends[0] if depends and c in worst else None)
        for c in channels
        if len(residuals[c].values) >= FEWEST
    )


def held_out_torque(
    calibrated: Model, lacking: Sequence[tuple[Model, Start]], prepared: Prepared
) -> Trace | None:
    """Torque on the hub that a model lacks in a recording which was not fitted; None where it cannot be estimated.

    As on the fit recordings: what the calibrated model lacks, with the part of it that the adopted effects explain;
    where residuals stay unexplained, what the final model lacks.

    Args:
      calibrated: the model that defines the filters.
      lacking: the model and its state at the first sample; of two, the difference is what the second explains.
      prepared: the recording.
    """
    data = DrivenData.of([prepared], calibrated)
    group = next((g for g in data.groups if g.channel == HUB_TORQUE), None)
    if group is None or data.weight[group.rows].sum() < FEWEST:
        return None
    keep, view = group.instants[data.weight[group.rows] > 0], data.views[0]
    values, *others = (
        raw_residual(view, prepared, with_fine_chain(model), start)[HUB_TORQUE][keep]
        for model, start in lacking
    )
    time = view.time[keep] - view.time[0]
    fitted = values - others[0] if others else None
    return Trace(HUB_TORQUE, time, values, {}, np.zeros(len(time), dtype=int), time, fitted=fitted)


def _trace(channel: str, left: Unexplained, explained_by: str | None) -> Trace:
    variables = left.variables | (travel(left) if explained_by == TRAVEL else {})
    since_start = left.variables["time"]
    return Trace(channel, left.time, left.values, variables, left.recording, since_start, explained_by)
