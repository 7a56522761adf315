"""Free runs as data of a fit: the zero of a gauge costs nothing, and a run that a stick decides is no data."""

from dataclasses import replace

import numpy as np

from twin.diagnosis.dependence import unexplained_residuals
from twin.effects import REGISTRY
from twin.estimation.fit import Fit
from twin.estimation.output_error import OutputErrorData, fit_output_error, on_driven_data
from twin.estimation.unknowns import effect_unknowns, start_unknowns
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 1e-3, "strain_base": 5e-6, "tip_deflection": 1e-4}
ZERO = 1e-4  # of the gauge
SENSORS = {
    "hub_angle": Sensor("hub_angle"),
    "strain_base": GAUGES[0],
    "torque_command": Sensor("torque_command"),
}
WITH_TIP = {"hub_angle": SENSORS["hub_angle"], "tip_deflection": Sensor("tip_deflection")}
TIME = 0.004 * np.arange(1000)


def rig(viscous):
    declared = preset("bossi2009")
    effects = {"viscous-friction": {"viscous": viscous}} if viscous else {}
    return Model(declared, SENSORS, chain.fit_shape(declared, 5), effects, 2e-3)


def measured(model, command, seed=0, time=TIME):
    """A noisy recording of a model under a command, the gauge off by `ZERO`."""
    channels = [c for c in model.sensors if c in NOISE]
    blank = {"torque_command": command, **{c: np.zeros_like(time) for c in channels}}
    run = simulate(model, Recording("a.csv", time, blank), Start())
    draw = np.random.default_rng(seed)
    noisy = {c: run[c] + NOISE[c] * draw.standard_normal(len(time)) for c in channels}
    if "strain_base" in noisy:
        noisy["strain_base"] = noisy["strain_base"] + ZERO
    return Recording("a.csv", time, {"torque_command": command, **noisy})


def bench_of(model, command, pool, period=np.inf):
    driven = DrivenData.of([prepare(measured(model, command), NOISE)[0]], model)
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


def test_of_samples_at_1_khz_every_other_one_is_compared(pool):
    time = 1e-3 * np.arange(3001)
    recording = measured(rig(0.05), np.interp(time, TIME, SQUARE), time=time)
    driven = DrivenData.of([prepare(recording, NOISE)[0]], rig(0.05))
    data = OutputErrorData(driven, rig(0.05))
    assert data.strides == (2,)
    assert {g.rows.stop - g.rows.start for g in data.groups} == {1501}
    assert fit_of(Workbench(data, pool), rig(0.05)).size.max() < 1.3


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


def test_a_tip_deflection_driven_by_a_rough_hub_leaves_its_noise(pool):
    """The hub's noise makes a lightly damped link ring: with that in them, sizes were 0.6 to 2.7."""
    plain, time = rig(0.05), 0.002 * np.arange(5500)
    lightly = plain.declared.replace(damping_ratio=0.005)
    model = plain.replace(declared=lightly, sensors=WITH_TIP)
    command = np.where(time < 0.5, 0.0, 0.3 * np.sign(np.sin(2 * np.pi * 0.9 * time)))
    draws = [prepare(measured(model, command, seed, time), NOISE)[0] for seed in range(3)]
    bench = Workbench(DrivenData.of(draws, model), pool)
    [residual] = bench.residuals([(model, (Start(),) * len(draws), None)])
    sizes = bench.sizes(residual)[[g.channel == "tip_deflection" for g in bench.groups]]
    assert 0.7 < sizes.min() < sizes.max() < 1.8


def test_a_first_state_that_a_wrong_model_left_in_another_minimum_is_found_anew(pool):
    model = rig(0.05)
    recording = measured(model, SQUARE).part(slice(300, None)).replace(start="unknown")
    driven = DrivenData.of([prepare(recording, NOISE)[0]], model)
    free = Workbench(OutputErrorData(driven, model), pool)
    unknowns = tuple(start_unknowns(driven.prepared))
    lost = Start(driven.prepared[0].start.hub_angle, -6.0, bend=(-0.01, 0.09), bend_rate=(2.4, -7.5))
    values = np.array(
        [getattr(lost, u.name) if u.index is None else getattr(lost, u.name)[u.index] for u in unknowns]
    )
    plain = fit_of(free, model)
    slopes = np.zeros((len(plain.residual), len(unknowns)))
    fit = replace(plain, starts=(lost,), unknowns=unknowns, values=values, jacobian=slopes)
    _, found = fit_output_error(free, fit)
    assert found.size.max() < 1.2


def test_of_minima_that_are_apart_the_likeliest_is_found(pool, monkeypatch):
    right = {"amplitude": 0.05, "order": 7.0, "phase": 0.3}
    wrong = {**right, "order": 11.0}
    model, trapped = (replace(rig(0.05), effects={"cogging": values}) for values in (right, wrong))
    unknowns = tuple(effect_unknowns("cogging", wrong, set()))
    _, free = bench_of(model, SQUARE, pool, 0.5)
    plain = fit_of(free, trapped)
    fit = replace(
        plain,
        unknowns=unknowns,
        values=np.array([wrong[u.name] for u in unknowns]),
        cost=free.cost(plain.residual),
        jacobian=np.zeros((len(plain.residual), len(unknowns))),
    )
    order = {}
    for others in ((), ({**right, "order": 7.2},)):
        monkeypatch.setattr(type(REGISTRY["cogging"]), "other_minima", lambda *_, others=others: others)
        _, found = fit_output_error(free, fit)
        order[bool(others)] = found.model.effects["cogging"]["order"]
    assert abs(order[False] - 7) > 1
    assert abs(order[True] - 7) < 0.1
