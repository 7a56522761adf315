"""Discretisation error of the chain, removed by Richardson extrapolation.

A chain of few segments whose proportions are fitted to the modes is accurate, but its remaining error does not fall
regularly with the number n of segments. With equal segments, and the curvature at a gauge interpolated from the hinges
near it, the error of every quantity is a n^-2 + b n^-4 + ..., at large bends too. So a few coarse chains of equal
segments give the limit n -> infinity (L. F. Richardson, 1911; W. Romberg, 1955).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.chain import Chain
from twin.mechanics.state import Start
from twin.residuals.filters import GRID
from twin.rigs.model import FixedStepModel, Model

ROUGH = (6, 8, 12)
"""Numbers of segments before a calibration: an error of half the noise at a resonance, in a quarter of the time."""
STANDARD = (8, 12, 16)
"""Numbers of segments that leave an error of about a tenth of the noise."""
_STENCIL = 4  # hinges between which the curvature at a gauge is interpolated


class UniformChainModel(FixedStepModel):
    """A model on a chain of equal segments, strains interpolated from the hinges near the gauge."""

    def gauge_row(self, links: Chain, x: float) -> np.ndarray:
        """See `Model.gauge_row`."""
        return _interpolated_curvature_row(links.hinges, self.rig["length"], x)


def with_equal_segments(model: Model, segments: int) -> UniformChainModel:
    """The model on a chain of this number of equal segments, with half the step of the grid.

    The frequency of an oscillation of 40 Hz is then off by 3e-5, (omega h)^4/120.
    """
    values = {f.name: getattr(model, f.name) for f in fields(model)}
    return UniformChainModel(**{**values, "shape": chain.uniform_shape(segments), "step": GRID / 2})


def _interpolated_curvature_row(hinges: np.ndarray, length: float, x: float) -> np.ndarray:
    """Row (n) from hinge angles [rad] to the curvature at x [1/m], by Lagrange interpolation.

    Args:
      hinges: positions of the hinges (n) [m].
      length: of the link [m]; a hinge angle over the length of a segment is the curvature at the hinge.
      x: position of the gauge [m].
    """
    near = np.argsort(np.abs(hinges - x))[:_STENCIL]
    row = np.zeros(len(hinges))
    for i in near:
        others = np.setdiff1d(near, i)
        row[i] = np.prod((x - hinges[others]) / (hinges[i] - hinges[others]))
    return row * len(hinges) / length


def richardson_weights(segments: Sequence[int]) -> np.ndarray:
    """Weights (k) of a quantity on chains with these numbers of segments (k) whose sum is its limit.

    They eliminate the error's first k - 1 powers of n^-2.
    """
    powers = np.array(segments, dtype=float) ** (-2.0 * np.arange(len(segments))[:, None])
    return np.linalg.solve(powers, np.eye(len(segments))[0])


def without_discretisation_error(
    bench: Workbench, model: Model, starts: Sequence[Start], segments: Sequence[int]
) -> tuple[Workbench, np.ndarray]:
    """A workbench whose residuals are corrected for the discretisation error of a model's chain.

    Args:
      bench: the data; an earlier correction is discarded.
      model, starts: where the error is evaluated. It is taken as constant in the neighbourhood.
      segments: numbers of segments of the equal chains to extrapolate from.

    Returns:
      The workbench, and the change of the residual (n) by the coarsest of these chains: the contribution of the
      highest power, an estimate of the remaining error.
    """
    none = np.zeros(len(bench.weight))
    plain = bench.with_defect(none).with_remaining_error(none)
    models = [model, *(with_equal_segments(model, n) for n in segments)]
    given, *uniform = plain.residuals([(m, starts, None) for m in models])
    at_limit = richardson_weights(segments) @ np.array(uniform)
    last = at_limit - richardson_weights(segments[1:]) @ np.array(uniform[1:])
    return bench.with_defect(given - at_limit), last


def with_limit(bench: Workbench, model: Model, starts: Sequence[Start], segments: Sequence[int]) -> Workbench:
    """A workbench whose residuals are corrected, and for which what remains of the error counts as noise.

    What remains is a discrepancy of known size: the model of the link is right in the limit, and the extrapolation says
    how near that it comes (M. C. Kennedy and A. O'Hagan, 2001). Arguments as `without_discretisation_error`.
    """
    bench, remaining = without_discretisation_error(bench, model, starts, segments)
    return bench.with_remaining_error(remaining)
