"""Where the unmodelled torque on the hub can be told in time."""

from __future__ import annotations

import numpy as np

from twin import hub_balance
from twin.driven import DrivenData
from twin.fit import Fit, Workbench
from twin.rigs.patch import HUB


def known_weights(bench: Workbench, fit: Fit) -> np.ndarray:
    """1 where a torque can be told in time, 0 about fast reversals under a sliding friction that falls with speed (n).

    There it jumps by twice the break-away torque within milliseconds: when the measured hub turns round is not known
    so well, and the filter spreads the jump.
    """
    told = np.ones(len(fit.residual))
    if not fit.model.plant.stribeck_velocity > 0:
        return told
    for group in bench.data.groups:
        if group.channel == HUB and isinstance(bench.data, DrivenData):
            told[group.rows] = ~hub_balance.near_reversals(bench.data.views[group.recording])
    return told
