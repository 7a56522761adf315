"""Free runs as data of a fit: the zero of a gauge costs nothing, and a run that a stick decides is no data."""

from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis.dependence import unexplained_residuals
from twin.estimation.fit import Fit
from twin.estimation.output_error import OutputErrorData, on_driven_data
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import effect_unknowns
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 1e-3, "strain_base": 5e-6}
ZERO = 1e-4  # of the gauge
SENSORS = {
    "hub_angle": Sensor("hub_angle"),
    "strain_base": GAUGES[0],
    "torque_command": Sensor("torque_command"),
}
TIME = 0.004 * np.arange(1000)


def rig(viscous):
    declared = preset("bossi2009")
    effects = {"viscous-friction": {"viscous": viscous}} if viscous else {}
    return Model(declared, SENSORS, chain.fit_shape(declared, 5), effects, 2e-3)


def measured(model, command):
    """A noisy recording of a model under a command, the gauge off by `ZERO`."""
    blank = {"torque_command": command, **{c: np.zeros_like(TIME) for c in NOISE}}
    run = simulate(model, Recording("a.csv", TIME, blank), Start())
    draw = np.random.default_rng(0)
    noisy = {c: run[c] + sigma * draw.standard_normal(len(TIME)) for c, sigma in NOISE.items()}
    noisy["strain_base"] = noisy["strain_base"] + ZERO
    return Recording("a.csv", TIME, {"torque_command": command, **noisy})


@pytest.fixture
def pool():
    with ResidualPool(1) as threads:
        yield threads


def bench_of(model, command, pool, period=np.inf):
    driven = DrivenData([prepare(measured(model, command), NOISE)[0]], model)
    return Workbench(driven, pool), Workbench(OutputErrorData(driven, model, period), pool)


def fit_of(bench, model):
    [residual] = bench.residuals([(model, (Start(),), None)])
    nothing = np.zeros(0)
    return Fit(
        model,
        (Start(),),
        (),
        nothing,
        np.zeros((0, 0)),
        residual,
        bench.sizes(residual),
        0.0,
        np.zeros((len(residual), 0)),
    )


SQUARE = np.where(TIME < 0.5, 0.0, 0.3 * np.sign(np.sin(2 * np.pi * 0.9 * TIME)))


def test_of_the_right_model_noise_is_left_though_the_zero_of_the_gauge_is_unknown(pool):
    model = rig(0.05)
    _, free = bench_of(model, SQUARE, pool)
    fit = fit_of(free, model)
    assert fit.size.max() < 1.2
    assert fit.size.min() > 0.8
    certain = {**SENSORS, "strain_base": Sensor("strain_base", None, 0.02, 0.001, zero_is_certain=True)}
    assert fit_of(free, model.replace(sensors=certain)).size.max() > 5


def test_a_missing_friction_shows_in_the_free_run(pool):
    _, free = bench_of(rig(0.05), SQUARE, pool)
    assert fit_of(free, rig(0.04)).size.max() > 20


def test_a_spring_leaves_the_right_model_its_noise_and_bounds_the_error_of_a_wrong_one(pool):
    model, wrong = rig(0.05), rig(0.04)
    _, free = bench_of(model, SQUARE, pool)
    _, pulled = bench_of(model, SQUARE, pool, 1.0)
    assert fit_of(pulled, model).size.max() < 1.2
    assert 5 < fit_of(pulled, wrong).size.max() < 0.5 * fit_of(free, wrong).size.max()


def test_with_a_spring_no_torque_that_hardly_breaks_the_hub_away_decides_the_rest_of_a_run(pool):
    dry = rig(0.0)
    hardly = np.where(TIME > 0.5, 1.0002 * dry.declared["static_friction"], 0.0)

    def change(period):
        _, bench = bench_of(dry, hardly, pool, period)
        plain, stuck = bench.residuals([(m, (Start(),), None) for m in (dry, dry.with_break_away(1.001))])
        return bench.sizes(stuck - plain).max()

    assert change(np.inf) > 100
    assert change(1.0) < 2


def test_a_fit_to_free_runs_has_a_residual_on_driven_data(pool):
    model = rig(0.05)
    driven, free = bench_of(model, SQUARE, pool)
    bench, fit = on_driven_data(free, fit_of(free, model))
    assert bench.data is driven.data
    assert len(fit.residual) == len(driven.weight)


def test_residuals_of_a_fit_to_free_runs_are_shown_on_driven_data(pool):
    model = rig(0.05)
    _, free = bench_of(model, SQUARE, pool)
    unknowns = tuple(effect_unknowns("viscous-friction", model.effects["viscous-friction"], free.channels()))
    fit = replace(fit_of(free, model), unknowns=unknowns, values=np.array([0.05]))
    [name] = [u.full_name for u in unknowns]
    torque = unexplained_residuals(free, fit)["hub_torque"]
    assert len(torque.slopes[name]) == len(torque.values) == len(torque.variables["hub_rate"])
