"""The torque that a model lacks in a recording that was not fitted."""

import numpy as np
import pytest

from twin.diagnosis import traces
from twin.mechanics import chain
from twin.mechanics.state import Start
from twin.recording import GAUGES, Recording, Sensor
from twin.residuals.filters import STRIDE
from twin.residuals.prepared import prepare
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import simulate

RIG = preset("bossi2009")
SENSORS = {"hub_angle": Sensor("hub_angle"), "strain_base": GAUGES[0]}
PLAIN = Model(RIG, SENSORS, chain.fit_shape(RIG, 5))
CABLE = {"stiffness": 0.02, "rest_angle": 0.2}
CABLED = PLAIN.replace(effects={"cable-torsion": CABLE})
NOISE = {"hub_angle": 1e-4, "strain_base": 1e-6}


@pytest.fixture(scope="module")
def prepared():
    """A slew of a rig with a cable, 3 s, measured with noise."""
    time = 0.002 * np.arange(1500)
    command = np.select([time < 0.2, time < 0.7, time < 1.2], [0.0, 0.15, -0.15], 0.0)
    empty = {name: np.zeros(len(time)) for name in SENSORS}
    given = Recording("slew.csv", time, {"torque_command": command, **empty}, loop="open")
    run = simulate(CABLED, given, Start())
    rng = np.random.default_rng(3)
    measured = {name: run[name] + NOISE[name] * rng.standard_normal(len(time)) for name in SENSORS}
    return prepare(given.replace(channels={"torque_command": command, **measured}), NOISE)[0]


def torque(prepared, *lacking):
    return traces.held_out_torque(PLAIN, [(model, Start()) for model in lacking], prepared)


def test_what_a_model_without_the_cable_lacks_is_its_torque(prepared):
    found = torque(prepared, PLAIN, CABLED)
    angle = np.interp(found.time, prepared.recording.time, prepared.recording["hub_angle"])
    cable = -CABLE["stiffness"] * (angle - CABLE["rest_angle"])
    assert len(found.time) > 300 / STRIDE
    # The median of a rough estimate: second differences of a noisy angle.
    assert np.median(np.abs(found.values - cable)) < 0.15 * np.ptp(cable)
    assert np.median(np.abs(found.fitted - cable)) < 0.05 * np.ptp(cable)
    assert np.corrcoef(found.fitted, cable)[0, 1] > 0.98


def test_where_residuals_are_unexplained_it_is_what_the_final_model_lacks(prepared):
    found = torque(prepared, CABLED)
    assert found.fitted is None
    lacking = torque(prepared, PLAIN)
    assert np.median(np.abs(found.values)) < 0.5 * np.median(np.abs(lacking.values))


def test_a_locked_hub_has_no_torque_balance(prepared):
    time = prepared.recording.time
    strain = 1e-4 * np.cos(8 * time)
    channels = {"torque_command": 0 * time, "strain_base": strain}
    locked = Recording("decay.csv", time, channels, True, "open", 0.03)
    assert torque(prepare(locked, NOISE)[0], PLAIN) is None
