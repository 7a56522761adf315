"""A drive of unknown gain: inertias, stiffness, friction and delivered torques that all grow alike move the same."""

import numpy as np
import pytest
from homogeneous import HOMOGENEOUS

from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.residuals.data import DrivenData
from twin.residuals.filters import GRID
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

NOISE = {"hub_angle": 3e-4, "strain_base": 2e-6}


def scaled(model, factor):
    """The model of a rig that is so many times as heavy, stiff and rough, its drive as much stronger."""
    rig = model.declared.replace(**{name: factor * model.declared[name] for name in HOMOGENEOUS})
    return model.replace(declared=rig, effects={"torque-gain": {"gain": factor}})


@pytest.fixture(scope="module")
def slewed():
    rig = preset("bossi2009")
    sensors = {"strain_base": Sensor("strain_base", position=0.02, half_thickness=0.0008)}
    model = Model(rig, sensors, chain.fit_shape(rig, 5), step=2.5e-4)
    time = np.arange(0, 2.0, GRID)
    torque = np.where((time > 0.2) & (time < 0.9), 0.15, 0.0) - np.where(
        (time > 0.9) & (time < 1.5), 0.15, 0.0
    )
    asked = {"torque_command": torque, "hub_angle": torque, "strain_base": torque}
    drawn = np.random.default_rng(7)
    read = simulate(model, Recording("", time, asked), Start()).channels
    read = {c: v + drawn.normal(scale=NOISE[c], size=len(time)) if c in NOISE else v for c, v in read.items()}
    prepared, _ = prepare(Recording("", time, read), NOISE)
    return DrivenData.of([prepared], model), model, prepared


@pytest.mark.parametrize("factor", [0.9, 1.06])
def test_how_large_the_rig_is_and_its_drive_with_it_is_no_matter_of_the_recordings(slewed, factor):
    data, model, prepared = slewed
    first, then = (data.residual(m, 0, prepared.start) for m in (model, scaled(model, factor)))
    assert np.abs(first["hub_torque"]).max() > 1
    for name, values in first.items():
        assert np.abs(then[name] - values).max() < 1e-6 * max(1.0, np.abs(values).max()), name


def test_a_gain_is_what_the_drive_makes_of_a_command_whatever_is_added(slewed):
    _, model, _ = slewed
    assert model.torque_gain == 1
    drive = {"torque-gain": {"gain": 1.06}, "torque-bias": {"bias": 0.02}, "actuator-delay": {"delay": 0.01}}
    assert model.replace(effects=drive).torque_gain == pytest.approx(1.06, rel=1e-12)
