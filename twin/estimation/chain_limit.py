"""What a chain of ever more segments comes to, by extrapolation.

A chain whose proportions are fitted is good with few segments, but what is left of its error does not fall steadily
with their number n. That of equal segments does: a n^-2 + b n^-4 + ... in every figure, however far the link bends, if
the curvature at a gauge is read off the hinges beside it. So a few coarse chains give the limit (L. F. Richardson,
1911; W. Romberg, 1955).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.chain import Chain
from twin.mechanics.state import Start
from twin.rigs.model import FINE_STEP, Model

ROUGH = (6, 8, 12)
"""Numbers of segments to begin with: they leave half a noise level at a resonance, in a third of the time."""
QUICK = (8, 12, 16)
"""Numbers of segments that leave an error of a tenth of the noise's or so."""
CLOSE = (8, 12, 16, 20)
"""Numbers of segments of a last step."""
_BESIDE = 4  # hinges between which the curvature at a gauge is interpolated


class EvenModel(Model):
    """A model on a chain of equal segments, strains read off the hinges beside the gauge."""

    def gauge_row(self, links: Chain, x: float) -> np.ndarray:
        """See `Model.gauge_row`."""
        return _row(links.hinges, self.rig["length"], x)


def even(model: Model, segments: int) -> EvenModel:
    """The model on a chain of so many equal segments, in steps as short as those of a fine one."""
    values = {f.name: getattr(model, f.name) for f in fields(model)}
    return EvenModel(**{**values, "shape": chain.uniform_shape(segments), "step": FINE_STEP})


def _row(hinges: np.ndarray, length: float, x: float) -> np.ndarray:
    """Curvature at x [m] of the polynomial through the curvatures at the hinges beside it (n) [1/m per rad]."""
    near = np.argsort(np.abs(hinges - x))[:_BESIDE]
    row = np.zeros(len(hinges))
    for i in near:
        others = np.setdiff1d(near, i)
        row[i] = np.prod((x - hinges[others]) / (hinges[i] - hinges[others]))
    return row * len(hinges) / length


def weights(segments: Sequence[int]) -> np.ndarray:
    """Weights (k) with which figures of chains of so many segments (k) give their limit, k - 1 powers of n^-2 out."""
    powers = np.array(segments, dtype=float) ** (-2.0 * np.arange(len(segments))[:, None])
    return np.linalg.solve(powers, np.eye(len(segments))[0])


def corrected(
    bench: Workbench, model: Model, starts: Sequence[Start], segments: Sequence[int]
) -> tuple[Workbench, np.ndarray]:
    """Takes the discretisation error of a model's chain out of the residuals of a bench.

    Args:
      bench: the data; whatever was taken out of it before is put back.
      model, starts: where the error is determined.
      segments: numbers of segments of the equal chains that give the limit.

    Returns:
      The data without the error, and the change (n) of the residual by the coarsest of these chains, which is the
      contribution of the highest power.
    """
    bench = bench.with_defect(np.zeros(len(bench.weight)))
    models = [model, *(even(model, n) for n in segments)]
    given, *found = bench.residuals([(m, starts, None) for m in models])
    at_limit = weights(segments) @ np.array(found)
    last = at_limit - weights(segments[1:]) @ np.array(found[1:])
    return bench.with_defect(given - at_limit), last
