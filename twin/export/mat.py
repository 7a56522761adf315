"""The linear model as a MATLAB file: `load rig.mat; G = ss(A, B, C, D)`."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from twin.export.base import Exported, Exporter, RigToExport
from twin.export.linear import LinearModel


class MatFile(Exporter):
    """A, B, C, D with names, units, operating point and delays, as MATLAB 5, which every later version reads."""

    name = "mat"
    suffix = ".mat"
    what = "linear state space about a hub angle, for MATLAB"

    def export(self, given: RigToExport) -> Exported:
        from scipy.io import savemat

        stream = io.BytesIO()
        savemat(stream, variables(given.linear), oned_as="column", do_compression=True)  # type: ignore[arg-type]
        return Exported(stream.getvalue(), given.linear.left_out)


def variables(linear: LinearModel) -> dict[str, Any]:
    """Returns the variables of the file; the names are those of the properties of `ss` where that has one."""
    return {
        "A": linear.A,
        "B": linear.B,
        "C": linear.C,
        "D": linear.D,
        "StateName": _cells(linear.states),
        "StateUnit": _cells(linear.state_units),
        "InputName": _cells(linear.inputs),
        "InputUnit": _cells(linear.input_units),
        "OutputName": _cells(linear.outputs),
        "OutputUnit": _cells(linear.output_units),
        "InputDelay": linear.input_delay,
        "OutputDelay": linear.output_delays,
        "hub_angle": linear.hub_angle,
        "u0": linear.command,
        "y0": linear.readings,
        "left_out": _cells(linear.left_out),
        "Notes": linear.title,
    }


def _cells(texts: tuple[str, ...]) -> np.ndarray:
    """A column of cells."""
    return np.array(texts, dtype=object)[:, None]
