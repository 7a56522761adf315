"""Variables on which what is left of a recording may depend."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.driven import DrivenData
from twin.fit import Fit
from twin.view import move


def in_recording(data: DrivenData, fit: Fit, i: int, left: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Name -> (m) what a fault may depend on, SI; strains as the model has them: a reading holds the fault itself.

    Args:
      data: the recordings.
      fit: of the model that moves.
      i: index of the recording.
      left: channel -> (m) what is missing in it, see `twin.driven_residual`.
    """
    view, prepared = data.views[i], data.prepared[i]
    motion, _ = move(view, prepared, fit.model, fit.starts[i])
    command = fit.model.drive(prepared.recording).at(view.time)
    found = {
        "hub_angle": motion.angles[:, 0],
        "hub_rate": motion.rates[:, 0],
        "torque_command": command,
        "time": view.time - view.time[0],
        "tip_rate": np.sum(
            np.cos(motion.angles - motion.angles[:, :1]) * motion.rates * fit.model.chain.lengths, 1
        ),
    }
    return found | {c: v - left[c] for c, v in view.measured.items() if c.startswith("strain")}
