"""Solves for chosen parameters of a rig such that its modes have published or measured frequencies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from twin.mechanics.beam import Boundary, modes
from twin.parameters import Rig


@dataclass(frozen=True)
class Reconciliation:
    """A rig solved for given frequencies.

    Attributes:
      rig: the rig with the changed values.
      moved: name of each changed parameter -> (value before, value after), SI.
      frequencies_hz: the given frequencies (n) [Hz].
      residual: (n) remaining relative error of each frequency [1].
    """

    rig: Rig
    moved: Mapping[str, tuple[float, float]]
    frequencies_hz: tuple[float, ...]
    residual: np.ndarray

    def __str__(self) -> str:
        parts = [f"{name} {before:.5g} -> {after:.5g}" for name, (before, after) in self.moved.items()]
        worst = np.max(np.abs(self.residual))
        return f"{', '.join(parts)}; frequencies met to {worst:.1g}"


def reconcile(
    rig: Rig,
    frequencies_hz: Sequence[float] = (7.27, 18.21),
    move: Sequence[str] = ("hub_inertia", "tip_inertia"),
    boundary: Boundary = "free",
) -> Reconciliation:
    """Solves for the parameters in `move` such that the first modes have `frequencies_hz`.

    Least squares on the logarithms of the frequencies, in the logarithms of the values, within the bounds of each
    parameter. Where no values reach the frequencies, `residual` has the remaining errors.

    Args:
      rig: initial values.
      frequencies_hz: frequencies of modes 1, 2, ... [Hz].
      move: names of the parameters to solve for; at most as many as there are frequencies.
      boundary: hub "free" or "clamped", as in `modes`.

    Raises:
      ValueError: more parameters than frequencies, or a parameter is not positive and has no logarithm.
    """
    if not 1 <= len(move) <= len(frequencies_hz):
        raise ValueError(
            f"{len(move)} parameters to move for {len(frequencies_hz)} frequencies;"
            " expected at least one parameter and at most one per frequency"
        )
    before = np.array([rig[name] for name in move])
    if not np.all(before > 0):
        raise ValueError(f"{move[int(np.argmin(before))]} is {before.min():g}; expected a positive number")
    wanted = 2 * np.pi * np.asarray(frequencies_hz, dtype=float)
    values = dict(rig)

    def errors(logarithms: np.ndarray) -> np.ndarray:
        values.update(zip(move, np.exp(logarithms), strict=True))
        return np.log(modes(values, len(wanted), boundary).frequencies / wanted)

    bounds = _log_bounds(rig, move)
    fit = least_squares(errors, np.log(before), bounds=bounds, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    after = {name: float(value) for name, value in zip(move, np.exp(fit.x), strict=True)}
    source = f"solved for modes at {', '.join(f'{f:g}' for f in frequencies_hz)} Hz, hub {boundary}"
    moved = {name: (rig[name], value) for name, value in after.items()}
    solved = rig.replace(source=source, **after)
    return Reconciliation(solved, moved, tuple(frequencies_hz), np.expm1(fit.fun))


def _log_bounds(rig: Rig, move: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the lower and upper bounds of the parameters."""
    bounds = np.array([rig.parameters[name].bounds for name in move])
    return np.log(np.maximum(bounds[:, 0], 1e-30)), np.log(bounds[:, 1])
