"""Gain and delay of channels as nuisance parameters of a fit: only where declared, near their truth, of no cost."""

from dataclasses import replace

import numpy as np
import pytest

from twin.diagnosis import fit_start, rays
from twin.estimation.minimise import minimise
from twin.estimation.output_error import OutputErrorData
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.unknowns import channel_unknowns, model_at
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.channel_errors import ChannelErrors
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 3e-4, "hub_rate": 0.01, "strain_base": 2e-6}
TIME = 0.002 * np.arange(1000)
TORQUE = np.where(TIME < 0.1, 0.0, 0.2 * np.sign(np.sin(2 * np.pi * 1.5 * TIME)))
TRUE = ChannelErrors(
    {"hub_angle": 1.02, "hub_rate": 0.97, "strain_base": 1.04}, {"hub_rate": 0.002, "strain_base": 0.003}
)
SENSORS = {
    "hub_angle": Sensor("hub_angle", gain_uncertainty=0.03),
    "hub_rate": Sensor("hub_rate", gain_uncertainty=0.05, delay_uncertainty=0.003),
    "strain_base": replace(GAUGES[0], gain_uncertainty=0.05, delay_uncertainty=0.003),
    "torque_command": Sensor("torque_command"),
}
RIG = preset("bossi2009")
MODEL = Model(RIG, SENSORS, chain.fit_shape(RIG, 5), {"viscous-friction": {"viscous": 0.01}}, 2e-3)


@pytest.fixture(scope="module")
def prepared():
    blank = {"torque_command": TORQUE, **{c: np.zeros_like(TIME) for c in NOISE}}
    run = simulate(MODEL.replace(channel_errors=TRUE), Recording("a.csv", TIME, blank), Start())
    draw = np.random.default_rng(0)
    noisy = {c: run[c] + sigma * draw.standard_normal(len(TIME)) for c, sigma in NOISE.items()}
    return prepare(Recording("a.csv", TIME, {"torque_command": TORQUE, **noisy}), NOISE)[0]


@pytest.mark.parametrize(
    "data", [lambda d: d, lambda d: OutputErrorData(d, MODEL)], ids=["driven", "free run"]
)
def test_they_come_near_the_truth(prepared, data):
    with ResidualPool(1) as pool:
        bench = Workbench(data(DrivenData.of([prepared], MODEL)), pool)
        unknowns = channel_unknowns(MODEL, bench.channels())
        fit = minimise(bench, MODEL, [Start()], unknowns)
    assert fit.size.max() < 1.5
    # The discretisation error of five segments is not removed here.
    for kind, values, tolerance in (("gain", TRUE.gains, 5e-3), ("delay", TRUE.delays, 3e-4)):
        for channel, value in values.items():
            fitted = fit.model.channel_errors.of(kind, channel)
            assert fitted == pytest.approx(value, abs=tolerance), (kind, channel)


def test_what_is_not_declared_is_certain():
    certain = {name: replace(s, gain_uncertainty=0.0, delay_uncertainty=0.0) for name, s in SENSORS.items()}
    assert channel_unknowns(MODEL.replace(sensors=certain), set(NOISE)) == []
    # Of a channel that no recording has there is nothing to fit.
    assert {u.name for u in channel_unknowns(MODEL, {"hub_rate"})} == {"hub_rate"}


def test_the_prior_is_the_declaration_and_ends_at_three_deviations():
    [hub] = [u for u in channel_unknowns(MODEL, {"hub_angle"})]
    assert (hub.start, hub.scale, hub.prior) == (1.0, 0.03, True)
    assert hub.bounds == pytest.approx((np.exp(-0.09), np.exp(0.09)))
    [late] = [u for u in channel_unknowns(MODEL, {"hub_rate"}) if u.kind == "delay"]
    assert (late.start, late.scale, late.bounds) == (0.0, 0.003, pytest.approx((-0.009, 0.009)))


def test_the_command_of_a_drive_has_a_gain_too_unless_the_drive_declares_it():
    declared = MODEL.replace(sensors={"torque_command": Sensor("torque_command", gain_uncertainty=0.1)})
    assert [(u.kind, u.name) for u in channel_unknowns(declared, set())] == [("gain", "torque_command")]
    known = declared.replace(effects={"torque-gain": {"gain": 1.0}})
    assert channel_unknowns(known, set()) == []


class _Bench:
    def channels(self):
        return set(NOISE)


def test_an_effect_replaces_the_error_of_a_channel_that_it_is():
    unknowns = channel_unknowns(MODEL, set(NOISE))
    values = np.array([u.start for u in unknowns])
    base = type(
        "Fit", (), {"unknowns": unknowns, "values": values, "model": model_at(MODEL, unknowns, values)}
    )
    late = rays.with_effect(base.model, "hub-sensor-gain", {"gain": 1.1})
    model = fit_start.without_replaced_errors(late)
    assert "hub_angle" not in model.channel_errors.gains
    assert model.channel_errors.gains.keys() == {"hub_rate", "strain_base"}
    fitted = fit_start.fit_unknowns(_Bench(), model, base)
    assert ("gain", "hub_angle") not in {(u.kind, u.name) for u in fitted}
    assert sum(u.is_channel_error for u in fitted) == len(unknowns) - 1
