"""The start of a fit among many sizes of an effect, compared recording by recording."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.diagnosis.rays import best_on_rays, with_effect
from twin.effects import REGISTRY
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.residuals.groups import Group
from twin.rigs import preset
from twin.rigs.model import Model

ROWS, TRUE = 100, 0.02  # N m s/rad
NAME, PARAMETER = "viscous-friction", "viscous"


class Recordings:
    """Recordings of which each has its own residual per deviation of the friction from the true one.

    Attributes:
      slopes: noise levels per N m s/rad, of each recording.
      simulated: index of each recording whose residual was asked for.
    """

    def __init__(self, *slopes):
        self.slopes, self.simulated = slopes, []
        self.prepared = tuple(
            SimpleNamespace(channels=("hub_angle",), recording=SimpleNamespace(duration=1.0)) for _ in slopes
        )
        self.groups = self.blocks = tuple(
            Group(i, "hub_angle", slice(i * ROWS, (i + 1) * ROWS)) for i in range(len(slopes))
        )
        self.weight = np.ones(ROWS * len(slopes))

    def counts(self):
        return np.full(len(self.slopes), float(ROWS))

    def residual(self, model, i, start):
        self.simulated.append(i)
        off = model.effects.get(NAME, {PARAMETER: 0.0})[PARAMETER] - TRUE
        return {"hub_angle": self.slopes[i] * off * np.ones(ROWS)}


def compared(data):
    """The best size with its cost, the cost without the effect, and the least cost of any size near the best."""
    rig = preset("bossi2009")
    model, starts = Model(rig, {}, chain.fit_shape(rig, 3), {}, 1e-3), (Start(),) * len(data.prepared)
    with ResidualPool(1) as pool:
        bench = Workbench(data, pool)
        [r] = bench.residuals([(model, starts, None)])
        base = SimpleNamespace(model=model, starts=starts, residual=r)
        best, cost = best_on_rays(bench, base, NAME)

        def cost_of(size):
            [off] = bench.residuals([(with_effect(model, NAME, {PARAMETER: size}), starts, None)])
            return bench.cost(off)

        sizes = np.geomspace(best[PARAMETER] / 3000, best[PARAMETER] * 3000, 400)
        assert cost == pytest.approx(cost_of(best[PARAMETER]))
        return best[PARAMETER], cost, bench.cost(r), min(cost_of(s) for s in sizes)


def test_recordings_that_do_not_tell_drop_no_size():
    some, _, _, _ = compared(Recordings(0.0, 4e3 * np.sqrt(3), 0.0))  # as visible over all rows
    alone, _, _, _ = compared(Recordings(4e3))
    assert some == alone


def test_the_size_is_one_that_all_recordings_like():
    best, cost, neutral, least = compared(Recordings(4e3, 2e3, 1e3, 5e2))
    assert least <= cost < neutral
    multiples = REGISTRY[NAME].search_multiples
    assert TRUE / max(multiples) < best < TRUE * max(multiples)


def test_most_sizes_are_not_simulated_on_all_recordings():
    data = Recordings(4e3, 4e3, 4e3, 4e3)
    compared(data)
    times = np.bincount(data.simulated)
    assert times[-1] < times[0]
