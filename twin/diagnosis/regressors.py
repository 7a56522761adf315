"""Variables on which what is left of a recording may depend."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.estimation.fit import Fit
from twin.residuals.data import DrivenData
from twin.residuals.view import View, move_link


def of_motion(data: DrivenData, fit: Fit, i: int) -> dict[str, np.ndarray]:
    """Name -> (m) what a fault may depend on, SI: the command of one recording, its time, and how the model moves."""
    view, prepared = data.views[i], data.prepared[i]
    motion, _ = move_link(view, prepared, fit.model, fit.starts[i])
    command = fit.model.drive(prepared.recording).at(view.time)
    return {
        "hub_angle": motion.angles[:, 0],
        "hub_rate": motion.rates[:, 0],
        "torque_command": command,
        "time": view.time - view.time[0],
        "tip_rate": np.sum(
            np.cos(motion.angles - motion.angles[:, :1]) * motion.rates * fit.model.chain.lengths, 1
        ),
    }


def of_strains(view: View, left: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Strain -> (m) as the model has it, of which `left` is missing: a reading holds the fault itself."""
    return {c: v - left[c] for c, v in view.measured.items() if c.startswith("strain")}
