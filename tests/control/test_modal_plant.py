"""Effects on the modal plant: on a small motion each changes what the chain's change is, and steps are fine enough."""

import numpy as np
import pytest
from marks import slow_except
from scipy.linalg import eigh, null_space

from twin.control.plants.base import READINGS
from twin.control.plants.chain import CompiledPlant
from twin.control.plants.modal import ModalPlant
from twin.control.plants.modal_rig import modal_rig
from twin.control.plants.sensor_effects import SensorEffects
from twin.effects import REGISTRY, Effect
from twin.errors import InputError
from twin.mechanics import chain
from twin.recording import GAUGES
from twin.rigs import preset
from twin.rigs.model import Model

# A tenth of the friction, for a tenth of the motion: the modal model has no large angles between link and hub.
RIG = preset("bossi2009").replace(static_friction=5.5e-3, coulomb_friction=4.5e-4)
SHAPE = chain.fit_shape(RIG, 6)
TORQUE = 0.02  # N m
# Effects of the hub and of the link, of a size that this motion shows.
MECHANICS = {
    "viscous-friction": {"viscous": 0.003},
    "stribeck-friction": {"stribeck_velocity": 0.2},
    "asymmetric-friction": {
        "static_positive": 6e-3,
        "static_negative": 7.2e-3,
        "coulomb_positive": 4e-4,
        "coulomb_negative": 2e-3,
    },
    "position-dependent-friction": {"amplitude": 4e-3, "order": 40.0, "phase": 0.6},
    "cable-torsion": {"stiffness": 0.012, "rest_angle": 0.2},
    "cogging": {"amplitude": 5e-3, "order": 30.0, "phase": -0.4},
    "actuator-lag": {"time_constant": 0.008},
    "gravity-tilt": {"tilt": 4e-3, "direction": 1.1},
    "periodic-disturbance": {
        "frequency": 6.0,
        "amplitude": 4e-3,
        "phase": 0.5,
        "base": 0.0,
        "direction": 0.0,
    },
    "payload-mass": {"tip_mass": 0.14},
    "stiffness-loss": {"bending_stiffness": 0.22},
    "softening-stiffness": {"softening": 0.3, "curvature": 0.1},
    "torsional-mode": {
        "frequency": 10.0,
        "damping_ratio": 0.05,
        "inertia_share": 0.5,
        "strain_base": 4e-3,
        "strain_mid": 3e-3,
    },
    "root-compliance": {"stiffness": 3.0},
    "air-drag": {"coefficient": 5.0},
    "air-pad-drag": {"viscous": 0.2},
}
SHAKEN = {"frequency": 3.0, "amplitude": 0.3, "phase": 0.5, "base": 1.0, "direction": 0.7}
CASES = [*MECHANICS.items(), ("periodic-disturbance", SHAKEN)]


def model(effects, **changes) -> Model:
    return Model(RIG, {g.channel: g for g in GAUGES}, SHAPE, effects, **changes)


def slew(plant, scale=1.0):
    """True values (400, 5) and modes (400) on a slew that sticks on the way."""
    plant.reset()
    readings, modes = [], []
    for k in range(400):
        plant.advance(scale * TORQUE * (1 if k < 125 else -1 if k < 250 else 0))
        readings.append([plant.read()[name] for name in READINGS])
        modes.append(plant.mode)
    return np.array(readings), np.array(modes)


@pytest.fixture(scope="module")
def plain():
    return slew(ModalPlant(model({})))[0], slew(CompiledPlant(model({})))[0]


@pytest.mark.parametrize(
    ("name", "p"), slow_except(CASES, "viscous-friction", "cable-torsion", "stiffness-loss")
)
def test_an_effect_changes_the_modes_as_it_changes_the_chain(plain, name, p):
    modal, links = (
        slew(kind(model({name: p})))[0] - without
        for kind, without in zip((ModalPlant, CompiledPlant), plain, strict=True)
    )
    # Hub, tip, and both strains. What is left is geometry, and the strain of higher modes.
    for off, change in zip((modal - links).T[:4], links.T[:4], strict=True):
        assert np.sqrt(np.mean(off**2)) < 0.03 * np.sqrt(np.mean(change**2))


def test_every_effect_of_the_mechanics_is_compared_or_refused():
    hooks = ("rig", "links", "plant", "hub_law")
    acting = {
        name
        for name, effect in REGISTRY.items()
        if any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in hooks)
    }
    assert acting == {*MECHANICS, "backlash"}
    with pytest.raises(InputError, match="backlash has no place in the modal plant"):
        ModalPlant(model({"backlash": {"gap": 0.02, "motor_inertia_share": 0.4}}))


@pytest.mark.parametrize("boundary", ["free", "clamped"])
@pytest.mark.parametrize("stiffness", [2.0, 6.0, 45.0])
def test_a_clamp_that_gives_lowers_the_frequencies_as_it_does_those_of_the_chain(stiffness, boundary):
    compliant = Model(RIG, {}, chain.fit_shape(RIG, 12), {"root-compliance": {"stiffness": stiffness}})
    rig = modal_rig(compliant, 3)
    allowed = np.eye(len(rig.mass)) if boundary == "free" else null_space(rig.hub[None])
    squares = eigh(allowed.T @ rig.stiffness @ allowed, allowed.T @ rig.mass @ allowed, eigvals_only=True)
    found = np.sqrt(squares[-4:-1])
    # The third one is the worst that three bending modes say of four shapes.
    np.testing.assert_allclose(found, compliant.chain.modes(boundary)[0][:3], rtol=1.5e-3)


@pytest.mark.slow
def test_forces_that_vary_are_of_second_order_through_stick_and_slip():
    effects = {
        name: MECHANICS[name]
        for name in (
            "stribeck-friction",
            "position-dependent-friction",
            "cogging",
            "softening-stiffness",
            "air-drag",
        )
    }
    effects["periodic-disturbance"] = SHAKEN
    *runs, (exact, modes) = (slew(ModalPlant(model(effects, step=1e-3 / n))) for n in (1, 2, 4, 32))
    assert np.count_nonzero(np.diff(modes)) > 3
    coarse, middle, fine = (np.abs(run - exact).max(axis=0)[:4] for run, _ in runs)
    np.testing.assert_allclose(coarse / middle, 4, rtol=0.2)
    np.testing.assert_allclose(middle / fine, 4, rtol=0.2)
    assert np.all(coarse < 1e-3 * np.ptp(exact, axis=0)[:4])


def test_a_link_hangs_as_the_chain_does_before_anything_moves():
    tilted = model({"gravity-tilt": {"tilt": 0.02, "direction": 1.1}, "root-compliance": {"stiffness": 6.0}})
    plants = ModalPlant(tilted), CompiledPlant(tilted)
    for plant in plants:
        plant.reset(0.7)
    modal, links = (plant.read() for plant in plants)
    assert modal["hub_angle"] == pytest.approx(0.7)
    for name in ("tip_deflection", "strain_base", "strain_mid"):
        assert modal[name] == pytest.approx(links[name], rel=0.02)
    ends = [plant.outline(plant.configuration[None])[0, -1] for plant in plants]
    np.testing.assert_allclose(*ends, atol=1e-5)


def test_bridges_see_the_twist_of_a_torsional_mode():
    twisted = model({"torsional-mode": MECHANICS["torsional-mode"]})
    plant = ModalPlant(twisted)
    effects_on_sensors = SensorEffects(twisted, plant)
    for _ in range(50):
        plant.advance(TORQUE)
    said, true = effects_on_sensors.read(plant.time(), plant.read()), plant.read()
    assert abs(plant.twist) > 1e-4
    assert said["strain_base"] - true["strain_base"] == pytest.approx(4e-3 * plant.twist)
