"""Discretisation error of the chain, removed by Richardson extrapolation.

The proportions of a chain are fitted to the first modes and to the statics of the link, see `twin.mechanics.chain`.
What remains of its error, in the modes beyond and at large bends, falls with the number n of segments as
a n^-2 + b n^-4 + .... So a few chains give the limit n -> infinity (L. F. Richardson, 1911; W. Romberg, 1955).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.residuals.filters import GRID
from twin.rigs.model import FixedStepModel, Model

ROUGH = (8, 12)
"""Numbers of segments before a calibration. They leave 0.2 noise levels on the demo, 2 at a resonance."""
STANDARD = (12, 16, 24)
"""Numbers of segments that leave 0.01 noise levels on the demo, 0.04 and 0.26 behind rough hub sensors.

With 8 in place of 24 they left 0.06 on the demo, and a compliant clamp came out 0.15 % too stiff, 1.3 standard errors,
from recordings of the virtual rig without noise (by hand): at a resonance that bends the link by a radian, eight
segments are too few for the series in n^-2."""
PRECISE = (8, *STANDARD)
"""Numbers of segments for the last steps of an identification: frequencies to 2e-6, see
tests/identification/test_errors.py, and hub inertias to 1.5e-4; with 20 in place of 24, to 2.5e-4."""


def with_segments(model: Model, segments: int) -> FixedStepModel:
    """The model on a chain of this number of segments, with half the step of the grid.

    The frequency of an oscillation of 40 Hz is then off by 3e-5, (omega h)^4/120.
    """
    values = {f.name: getattr(model, f.name) for f in fields(model)}
    shape = chain.fit_shape_of_similar_rig(model.rig, segments)
    return FixedStepModel(**{**values, "shape": shape, "step": GRID / 2})


def _with_segments(given: tuple[Model, int], _: ResidualPool) -> FixedStepModel:
    return with_segments(*given)


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
      segments: numbers of segments of the chains to extrapolate from.

    Returns:
      The workbench, and the change of the residual (n) by the coarsest of these chains: the contribution of the
      highest power, an estimate of the remaining error.
    """
    none = np.zeros(len(bench.weight))
    plain = bench.with_defect(none).with_remaining_error(none)
    models = [model, *bench.pool.spread(_with_segments, [(model, n) for n in segments], segments)]
    given, *finer = plain.residuals([(m, starts, None) for m in models])
    at_limit = richardson_weights(segments) @ np.array(finer)
    last = at_limit - richardson_weights(segments[1:]) @ np.array(finer[1:])
    return bench.with_defect(given - at_limit), last


def with_limit(bench: Workbench, model: Model, starts: Sequence[Start], segments: Sequence[int]) -> Workbench:
    """A workbench whose residuals are corrected, and for which what remains of the error counts as noise.

    What remains is a discrepancy of known size: the model of the link is right in the limit, and the extrapolation says
    how near that it comes (M. C. Kennedy and A. O'Hagan, 2001). Arguments as `without_discretisation_error`.
    """
    bench, remaining = without_discretisation_error(bench, model, starts, segments)
    return bench.with_remaining_error(remaining)
