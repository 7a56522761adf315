"""One harness for every effect in the registry."""

import numpy as np
import pytest
from planted import PLANTED

from twin.effects import REGISTRY
from twin.mechanics import chain
from twin.mechanics.mujoco_chain import MujocoChain
from twin.mechanics.state import Start
from twin.recording import Recording, Sensor
from twin.rigs import preset
from twin.rigs.model import Model
from twin.rigs.simulate import initial_state, integrate, simulate

GAUGES = {
    "strain_base": Sensor("strain_base", 2e-6, 0.02, 8e-4),
    "strain_mid": Sensor("strain_mid", 2e-6, 0.21, 8e-4),
}
SHAKEN = {"frequency": 6.0, "amplitude": 0.3, "phase": 0.5, "base": 1.0, "direction": 0.7}
CASES = [*PLANTED.items(), ("periodic-disturbance", SHAKEN)]


def slew(duration: float = 1.5) -> Recording:
    """A slew that sticks on the way, sampled at 500 Hz, with nothing measured yet."""
    time = np.arange(0, duration, 0.002)
    command = np.where(time < 0.35, 0.15, np.where(time < 0.75, -0.14, 0.0))
    channels = {
        name: np.zeros_like(time) for name in ("hub_angle", "strain_base", "strain_mid", "motor_torque")
    }
    return Recording("slew", time, {"torque_command": command, **channels})


def model(**effects) -> Model:
    """The published rig with effects."""
    rig = preset("bossi2009")
    return Model(rig, GAUGES, chain.fit_shape(rig, 6), effects, step=5e-4)


def test_every_effect_has_a_planted_size():
    assert set(PLANTED) == set(REGISTRY)


@pytest.mark.parametrize("name", REGISTRY)
def test_neutral_changes_nothing(name):
    plain, neutral = model(), model(**{name: REGISTRY[name].neutral(preset("bossi2009"))})
    a, b = (simulate(m, slew(), Start()) for m in (plain, neutral))
    for channel in a.channels:
        np.testing.assert_array_equal(a[channel], b[channel])


@pytest.mark.parametrize(("name", "planted"), CASES)
def test_a_planted_effect_is_visible(name, planted):
    # Ten noise levels in some channel: an effect that acts nowhere cannot be found.
    noise = {"hub_angle": 3e-4, "strain_base": 2e-6, "strain_mid": 2e-6, "motor_torque": 1e-3}
    a, b = (simulate(m, slew(), Start(hub_angle=0.3)) for m in (model(), model(**{name: planted})))
    assert max(np.max(np.abs(a[c] - b[c])) / noise[c] for c in noise) > 10


@pytest.mark.parametrize(("name", "planted"), CASES)
def test_mujoco_moves_the_same(name, planted):
    augmented = model(**{name: planted})
    recording = slew(0.6)
    compiled = integrate(augmented, recording, Start(hub_angle=0.1))
    drive = augmented.drive(recording)
    engine = MujocoChain(augmented.rig, augmented.chain, augmented.plant, augmented.hub_torques)
    phi = augmented.plant.extend_state(initial_state(augmented, recording, Start(hub_angle=0.1))[0])
    times, torques = np.r_[-1e3, drive.time], np.r_[drive.before, drive.torque]
    angles, _, _ = engine.simulate(times, torques, recording.time, phi, 0 * phi, 0, False, 5e-4)
    # Sticks and slips are located to 1e-7 s by either engine, in their own way.
    np.testing.assert_allclose(angles, compiled.state()[0], atol=5e-5)


@pytest.mark.parametrize("name", REGISTRY)
def test_parameters_have_units_bounds_and_a_docstring(name):
    effect = REGISTRY[name]
    assert effect.__doc__
    for p in effect.parameters:
        assert p.unit
        assert p.bounds[0] < p.bounds[1]
        assert p.step != 0


def test_a_base_swings_along_one_line_whatever_noise_makes_of_it():
    effect, line, phase = REGISTRY["periodic-disturbance"], -0.4, 1.9
    swing = 0.3 * np.outer([np.cos(line), np.sin(line)], [np.cos(phase), np.sin(phase)])
    found = effect.wave_parameters(4.0, tuple((swing + 1e-4 * np.array([[1, -1], [1, 1]])).ravel()))
    assert found["base"] == 1.0
    assert [found[k] for k in ("frequency", "amplitude", "phase", "direction")] == pytest.approx(
        [4.0, 0.3, phase, line], abs=2e-3
    )
    assert effect.units(found)["amplitude"] == "m/s^2"
    assert "direction" in {p.name for p in effect.free_parameters(found)}
    torque = effect.wave_parameters(4.0, (0.0, 0.01))
    assert torque["base"] == 0.0
    assert effect.units(torque)["amplitude"] == "N*m"
    assert {p.name for p in effect.free_parameters(torque)} == {"frequency", "amplitude", "phase"}


@pytest.mark.parametrize("base", [0.0, 1.0])
def test_a_disturbance_counts_from_the_start_of_each_recording(base):
    values = {"frequency": 1.3, "amplitude": 0.02, "phase": 0.4, "base": base, "direction": 0.7}
    read = [
        simulate(model(**{"periodic-disturbance": values}), r.replace(time=r.time + begin), Start())
        for begin, r in ((0.0, slew(0.5)), (0.25, slew(0.5)))
    ]
    for channel in ("hub_angle", "strain_base"):
        np.testing.assert_allclose(read[0][channel], read[1][channel], rtol=1e-6, atol=1e-9)


def test_a_simulation_that_ran_away_is_no_error_of_a_late_sensor():
    late = {"delay": 2e-3, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}
    lost = np.array([0.0, 1e-4, np.nan, np.nan])
    said = REGISTRY["sensor-delay"].sensing(np.arange(4) * 1e-2, {"strain_base": lost}, late)
    np.testing.assert_array_equal(said["strain_base"], lost)


LINEAR = [name for name, effect in REGISTRY.items() if effect.linear_coefficients(PLANTED[name])]


@pytest.mark.parametrize("name", LINEAR)
def test_coefficients_in_which_a_force_is_linear_stand_for_its_parameters(name):
    effect, values = REGISTRY[name], PLANTED[name]
    assert effect.from_linear_coefficients(effect.linear_coefficients(values)) == pytest.approx(values)
    # Twice the force, from where it came from.
    [size] = [p.name for p in effect.parameters if p.name not in effect.undefined_at_neutral]
    twice = effect.from_linear_coefficients([2 * c for c in effect.linear_coefficients(values)])
    assert twice == pytest.approx({**values, size: 2 * values[size]})


def test_a_cable_that_pushes_is_none():
    assert REGISTRY["cable-torsion"].from_linear_coefficients((-1e-3, 2e-3)) is None


@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_what_late_sensors_first_show_of_a_rig_that_moves_is_older_than_its_simulation(rate):
    time = np.arange(0, 0.2, 0.002)
    angle = rate * time + np.exp(-30 * time) * time**2
    late = {"delay": 0.019, "hub_angle": 1.0, "strain": 1.0, "motor_torque": 0.0}
    shown = REGISTRY["sensor-delay"].sensing(time, {"hub_angle": angle}, late)["hub_angle"]
    before = time < 0.019
    np.testing.assert_allclose(shown[before], rate * (time[before] - 0.019), atol=1e-6)
    np.testing.assert_allclose(shown[~before], np.interp(time[~before] - 0.019, time, angle), atol=1e-4)
