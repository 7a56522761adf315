"""Runs as CSV files in the recording format, so that every reader of recordings reads them back."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.closed_loop import Run
from twin.errors import InputError


def columns(run: Run) -> dict[str, np.ndarray]:
    """Returns the columns of a run by name (m each): the recording's, then `mode` and the controller's states."""
    channels = run.recording("run").channels
    states = {f"state_{name}": values for name, values in run.states.items()}
    return {"time": run.time, **channels, "mode": run.modes, **states}


def write_csv(run: Run, path: Path) -> None:
    """Writes a run.

    Raises:
      InputError: the path cannot be written.
    """
    table = columns(run)
    try:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(table)
            writer.writerows(_rows(table))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error


def _rows(table: Mapping[str, np.ndarray]):
    # 9 digits: 1e-8 rad of a turn, far below any sensor.
    for row in zip(*table.values(), strict=True):
        yield [f"{value:.9g}" for value in row]
