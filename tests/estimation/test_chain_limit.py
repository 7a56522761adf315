"""What remains of the discretisation error counts as noise, in the stretches in which it remains."""

import numpy as np
import pytest

from twin.estimation import chain_limit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 5e-6, "strain_base": 2e-8}
TIME = 0.002 * np.arange(2500)


@pytest.fixture
def swinging():
    """The data of a link that a fast slew has bent far, its sensors quiet; model and initial states."""
    rig = preset("bossi2009")
    sensors = {"hub_angle": Sensor("hub_angle"), "strain_base": GAUGES[0]}
    model = Model(
        rig, {**sensors, "torque_command": Sensor("torque_command")}, chain.fit_shape(rig, 5), {}, 2e-3
    )
    slew = 0.2 * np.sign(np.sin(2 * np.pi * TIME / 1.2)) * ((TIME > 0.5) & (TIME < 2.9))
    blank = {"torque_command": slew, "hub_angle": np.zeros(2500), "strain_base": np.zeros(2500)}
    exact = simulate(with_fine_chain(model), Recording("a.csv", TIME, blank), Start())
    draw = np.random.default_rng(3)
    read = {c: exact[c] + NOISE[c] * draw.standard_normal(2500) for c in NOISE}
    prepared = prepare(Recording("a.csv", TIME, {"torque_command": slew, **read}), NOISE)[0]
    with ResidualPool(1) as pool:
        yield Workbench(DrivenData.of([prepared], model), pool), model, (prepared.start,)


def test_noise_grows_by_the_size_of_an_error_in_each_stretch(swinging):
    bench, model, starts = swinging
    [before] = bench.residuals([(model, starts, None)])
    first, *others = bench.groups
    error = np.zeros(len(before))
    error[first.rows] = 2.0
    [after] = bench.with_remaining_error(error).residuals([(model, starts, None)])
    np.testing.assert_allclose(after[first.rows], before[first.rows] / np.sqrt(5))
    for group in others:
        np.testing.assert_allclose(after[group.rows], before[group.rows])


def test_how_much_remains_is_known(swinging):
    bench, model, starts = swinging
    coarse = 8, 12, 16  # of a bend by a radian and finer chains the estimate may be half of what remains
    rough, fine = (
        chain_limit.without_discretisation_error(bench, model, starts, segments)[0].defect
        for segments in (coarse, (12, 16, 24))
    )
    remaining = bench.sizes(rough - fine)
    rows = [g.rows.start for g in bench.groups]
    known = chain_limit.with_limit(bench, model, starts, coarse).deviation[rows]
    assert remaining.max() > 1
    # The last order of an extrapolation is larger than those behind it.
    ratios = known / np.hypot(1.0, remaining)
    assert 0.9 < ratios.min() < ratios.max() < 3


def test_a_second_correction_keeps_the_noise_by_which_fits_are_compared(swinging):
    bench, model, starts = swinging
    with_error = chain_limit.with_limit(bench, model, starts, chain_limit.ROUGH)
    again, _ = chain_limit.without_discretisation_error(with_error, model, starts, chain_limit.STANDARD)
    assert again.deviation is with_error.deviation
    plain, _ = chain_limit.without_discretisation_error(bench, model, starts, chain_limit.STANDARD)
    np.testing.assert_allclose(again.defect, plain.defect)
