"""What is shown of the unexplained: its history, and over what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from twin.diagnosis.answer import Trace
from twin.diagnosis.dependence import (
    _FEWEST_SHOWN,
    TRAVEL,
    Unexplained,
    _travel,
    unexplained_residuals,
    variance_shares,
)
from twin.diagnosis.state import SearchState
from twin.recording import HUB_TORQUE

_SHOWN = (HUB_TORQUE, "strain_base", "strain_mid", "tip_deflection", "tip_acceleration")


def traces_of(found: SearchState, behind: Mapping[str, Unexplained]) -> tuple[Trace, ...]:
    """What the calibrated model leaves unexplained of each channel, those that the effects explain best first.

    `behind` is what the model leaves that stands at the end.
    """
    traces = []
    before = unexplained_residuals(found.bench, found.data, found.base) if found.adopted else behind
    for channel in _SHOWN:
        if channel not in before or len(before[channel].values) < _FEWEST_SHOWN:
            continue
        left, after = before[channel], behind[channel]
        gained = float(np.log(np.std(left.values) / max(np.std(after.values), 1e-30)))
        order = variance_shares(left)
        explained = order[0][0] if order and order[0][1] > 0.1 else None
        trace = _trace(channel, left, explained)
        fitted = left.values - after.values if found.adopted else None
        traces.append((gained, replace(trace, fitted=fitted)))
    return tuple(trace for _, trace in sorted(traces, key=lambda pair: -pair[0]))


def remaining(
    behind: Mapping[str, Unexplained], worst: Sequence[str], depends: Sequence[str]
) -> tuple[Trace, ...]:
    """What the model that stands at the end leaves of each channel.

    Args:
      behind: channel -> its residuals.
      worst: channels that are not explained; they come first.
      depends: variables on which what is left of these depends, the first most.
    """
    channels = [c for c in dict.fromkeys((*worst, *_SHOWN)) if c in behind]
    return tuple(
        _trace(c, behind[c], depends[0] if depends and c in worst else None)
        for c in channels
        if len(behind[c].values) >= _FEWEST_SHOWN
    )


def _trace(channel: str, left: Unexplained, explained_by: str | None) -> Trace:
    variables = left.variables | (_travel(left) if explained_by == TRAVEL else {})
    since_start = left.variables["time"]
    return Trace(channel, left.time, left.values, variables, left.recording, since_start, explained_by)
