"""A play between motor and hub, seen from a hub whose motion is measured."""

from __future__ import annotations

import numpy as np
import pytest

from twin.estimation import chain_limit
from twin.estimation.residual_pool import ResidualPool
from twin.estimation.workbench import Workbench
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.residuals import backlash
from twin.residuals.data import DrivenData
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model, with_fine_chain
from twin.rigs.simulate import simulate

_RATE = 500.0
_NOISE = {"hub_angle": 2e-4}
_SHARE = 0.4


def _model(gap: float) -> Model:
    rig = preset("bossi2009")
    effects = {"backlash": {"gap": gap, "motor_inertia_share": _SHARE}} if gap else {}
    sensors = {"hub_angle": Sensor("hub_angle", noise=_NOISE["hub_angle"])}
    return Model(rig, sensors, chain.fit_shape(rig, 5), effects, step=2e-3)


def _sweep(first: float, last: float, peak: float, seconds: float) -> np.ndarray:
    t = np.arange(round(seconds * _RATE)) / _RATE
    return peak * np.sin(2 * np.pi * (first * t + (last - first) * t**2 / (2 * seconds)))


def _data(gap: float, torque: np.ndarray) -> DrivenData:
    """A recording of a hub with a play, as the search looks at it."""
    time = np.arange(len(torque)) / _RATE
    asked = Recording("", time, {"torque_command": torque, "hub_angle": 0 * time}, loop="open")
    hub = simulate(with_fine_chain(_model(gap)), asked, Start())["hub_angle"]
    noise = np.random.default_rng(5).normal(0, _NOISE["hub_angle"], len(time))
    prepared, _ = prepare(
        asked.replace(channels={"torque_command": torque, "hub_angle": hub + noise}), _NOISE
    )
    return DrivenData.of([prepared], _model(0.0))


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.012, 0.015])
def test_width_is_where_what_is_left_is_least(gap):
    data = _data(gap, _sweep(3.0, 17.0, 0.13, 8.0))
    with ResidualPool(1) as pool:
        bench = Workbench(data, pool)
        starts = [p.start for p in data.prepared]
        bench, _ = chain_limit.without_discretisation_error(bench, _model(0.0), starts, chain_limit.PRECISE)
        widths = gap * np.array([0.0, 0.9, 0.95, 1.0, 1.05, 1.1])
        costs = [bench.cost(r) for r in bench.residuals([(_model(w), starts, None) for w in widths])]
    assert widths[np.argmin(costs)] == gap
    assert costs[0] - costs[3] > 500


def test_motor_that_rattles_is_not_asked_what_it_did():
    data = _data(0.015, _sweep(3.0, 25.0, 0.13, 8.0))
    view, prepared = data.views[0], data.prepared[0]
    noise = view.noise["hub_torque"]
    found = backlash.undetermined(view, prepared, _model(0.015), noise, 0.0)
    # Up to 11 Hz the motor comes to rest on a flank in every half of a period.
    assert not found[view.time < 3.0].any()
    assert found[view.time > 6.0].mean() > 0.3
    assert not backlash.undetermined(view, prepared, _model(0.0), noise, 1.0).any()


def test_hub_that_friction_may_hold_between_impacts_is_not_told():
    data = _data(0.0063, _sweep(15.0, 25.0, 0.13, 6.0))
    view, prepared, model = data.views[0], data.prepared[0], _model(0.0063)
    noise = view.noise["hub_torque"]
    held = backlash.undetermined(view, prepared, model, noise, 0.1) & ~backlash.undetermined(
        view, prepared, model, noise, 0.0
    )
    # Some of the sweep, and not most of it.
    assert 0 < held[view.sliding].mean() < 0.5
    slack = model.with_friction(static_positive=0.0, static_negative=0.0)
    assert not (backlash.undetermined(view, prepared, slack, noise, 0.1) & held).any()


def test_models_that_differ_in_the_link_share_the_torque_through_a_play(monkeypatch):
    data, solved = _data(0.012, _sweep(3.0, 10.0, 0.13, 2.0)), []
    solve = backlash._solve
    monkeypatch.setattr(backlash, "_solve", lambda *a: solved.append(a) or solve(*a))
    model = _model(0.012)
    stiff = model.replace(declared=model.declared.replace(bending_stiffness=2.2))
    heavy = model.replace(declared=model.declared.replace(hub_inertia=0.02))

    def balance(data, model):
        return data.residual(model, 0, data.prepared[0].start)["hub_torque"]

    found = [balance(data, m) for m in (model, stiff, heavy, _model(0.013))]
    assert len(solved) == 3
    assert not np.array_equal(found[0], found[1])
    # As computed without what is kept.
    np.testing.assert_array_equal(found[1], balance(_data(0.012, _sweep(3.0, 10.0, 0.13, 2.0)), stiff))
