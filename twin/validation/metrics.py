"""Performance metrics of one run, which the requirements limit."""

from __future__ import annotations

import math

import numpy as np

from twin.control.closed_loop import Run
from twin.validation.requirements import SETTLING_BAND

_FINAL_SPAN = 1.0  # s at the end of a run in which the rig should be at rest


def performance_metrics(run: Run, length: float) -> dict[str, float]:
    """Returns the metrics of a run whose reference ends at rest, by name of the requirement, in its unit.

    Args:
      run: from rest at zero.
      length: of the link [m].
    """
    step = float(run.reference[-1])
    error = (run.true["hub_angle"] - step) / step
    last = run.time >= run.time[-1] - _FINAL_SPAN
    tip, torque = run.true["tip_deflection"], np.abs(run.torque_command)
    return {
        "overshoot": 100 * max(float(error.max()), 0.0),
        "settling_time": _settling_time(run.time, error),
        "steady_state_error": 100 * abs(float(error[last].mean())),
        "residual_vibration": 100 * float(np.ptp(tip[last])) / length,
        "peak_deflection": 100 * float(np.abs(tip).max()) / length,
        "peak_torque": float(np.abs(run.true["motor_torque"]).max()),
        "saturated_share": 100 * float(np.mean(torque >= run.torque_limit * (1 - 1e-9))),
    }


def _settling_time(time: np.ndarray, error: np.ndarray) -> float:
    """First time [s] from which the relative error (m) stays within the band; infinite if it does not."""
    outside = np.flatnonzero(np.abs(error) > SETTLING_BAND)
    if not len(outside):
        return float(time[0])
    last = int(outside[-1])
    return float(time[last + 1]) if last + 1 < len(time) else math.inf
